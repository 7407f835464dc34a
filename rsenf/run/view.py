"""Views of a running graph: a table on a terminal, or log lines (plain or JSON)."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rsenf.config import Graph
from rsenf.run import log
from rsenf.run.node_state import HANGS, WENT_WRONG

if TYPE_CHECKING:
    from rich.table import Table

    from rsenf.messages import Health
    from rsenf.run.graph_run import GraphRun
    from rsenf.run.node_state import NodeState

_COLOURS = {
    "starting": "yellow", "waiting": "yellow", "restarting": "yellow",
    "running": "green", "done": "blue",
    "lost": "bold red", "failed": "bold red", "silent": "bold red", "stalled": "bold red",
}  # fmt: skip
_COUNTS: dict[str, Callable[[Health], object]] = {
    "in/s": lambda h: f"{h.rate_hz:.1f}", "in": lambda h: h.messages_in,
    "out": lambda h: h.messages_out, "missed": lambda h: h.missed,
    "dropped": lambda h: h.dropped, "queue": lambda h: h.queue_depth,
    "again": lambda h: h.restarts or "",
}  # fmt: skip


class LineView:
    """One line for each change of state, for logs and pipes."""

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._begun = time.monotonic()

    def started(self, run: GraphRun) -> None:
        """Print the address of the bus."""
        if not self._quiet:
            self._print(f"bus at {run.endpoint}, run {run.run_id}")

    def update(self, node: NodeState) -> None:
        """Print a node's new state."""
        if not self._quiet or node.state in (*WENT_WRONG, *HANGS):
            pid = f" pid {node.process.pid}" if node.process and node.state == "running" else ""
            self._print(f"{node.name}: {node.state}{pid} {node.detail}".rstrip())

    def _print(self, text: str) -> None:
        print(f"rsenf {time.monotonic() - self._begun:6.2f} s  {text}", file=sys.stderr, flush=True)


class JsonView:
    """One line of JSON for each change of state, for log collectors."""

    def __init__(self, graph: Graph, *, quiet: bool) -> None:
        self._graph, self._quiet = graph, quiet

    def started(self, run: GraphRun) -> None:
        """Print the address of the bus."""
        if not self._quiet:
            self._print(log.line("info", f"bus at {run.endpoint}, run {run.run_id}"))

    def update(self, node: NodeState) -> None:
        """Print a node's new state."""
        if self._quiet and node.state not in (*WENT_WRONG, *HANGS):
            return
        again = "warning" if node.state in ("restarting", *HANGS) else "info"
        level = "error" if node.went_wrong else again
        of = dict.fromkeys(camera for _, camera in self._graph.nodes[node.name].outputs())
        cameras = ", ".join(of) if node.kind != "reference" else ""
        message = f"{node.state} {node.detail}".rstrip()
        self._print(log.line(level, message, node=node.name, camera=cameras))

    def _print(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)


class TableView:
    """A table on a terminal, redrawn in place."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._run: GraphRun | None = None
        self.refresh: Callable[[], None] = lambda: None

    def started(self, run: GraphRun) -> None:
        """Draw for the first time."""
        self._run = run
        self.refresh()

    def update(self, node: NodeState) -> None:
        """Draw again."""
        self.refresh()

    def __rich__(self) -> Table | str:
        return _table(self._graph, self._run) if self._run else ""


def _table(graph: Graph, run: GraphRun) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(f"{graph.site}   bus at {run.endpoint}   run {run.run_id}"))
    for name in ("node", "state", "pid", *_COUNTS, ""):
        table.add_column(name, justify="left" if name in ("node", "state", "") else "right")
    for node in run.nodes.values():
        report = node.health
        counts = [str(count(report)) if report else "" for count in _COUNTS.values()]
        lost = f"lost: {', '.join(report.lost_peers)} " if report and report.lost_peers else ""
        pid = str(node.process.pid) if node.process else ""
        state = f"[{_COLOURS.get(node.state, 'white')}]{node.state}[/]"
        table.add_row(node.name, state, pid, *counts, escape(lost + node.detail))
    return table


@contextmanager
def view_of(graph: Graph, *, quiet: bool) -> Iterator[LineView | JsonView | TableView]:
    """Yield the view that suits stderr: JSON if asked for, a table on a terminal, or else lines."""
    if log.is_json():
        yield JsonView(graph, quiet=quiet)
        return
    if quiet or not sys.stderr.isatty():
        yield LineView(quiet=quiet)
        return
    from rich.console import Console
    from rich.live import Live

    view = TableView(graph)
    with Live(view, console=Console(stderr=True), refresh_per_second=4) as live:
        view.refresh = live.refresh
        yield view
