"""How a running graph looks on a terminal, and in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rsenf.config import Graph

if TYPE_CHECKING:
    from rsenf.run.graph_run import GraphRun, NodeState

_COLOURS = {
    "running": "green", "done": "blue", "lost": "bold red", "failed": "bold red",
    "starting": "yellow",
}  # fmt: skip


class LineView:
    """One line for each change of state, for logs and pipes."""

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._begun = time.monotonic()

    def started(self, run: GraphRun) -> None:
        """Say where the bus is."""
        self._print(f"bus at {run.endpoint}, run {run.run_id}")

    def update(self, node: NodeState) -> None:
        """Say a node's new state."""
        if not self._quiet or node.state in ("lost", "failed"):
            pid = f" pid {node.process.pid}" if node.process and node.state == "running" else ""
            self._print(f"{node.name}: {node.state}{pid} {node.detail}".rstrip())

    def _print(self, text: str) -> None:
        if not self._quiet or "lost" in text or "failed" in text:
            print(
                f"rsenf {time.monotonic() - self._begun:6.2f} s  {text}",
                file=sys.stderr,
                flush=True,
            )


class TableView:
    """A table that is redrawn in place, for people."""

    def __init__(self, graph: Graph, live: Any) -> None:
        self._live, self._run = live, None
        self._graph = graph

    def started(self, run: Any) -> None:
        """Begin to draw."""
        self._run = run
        self._live.get_renderable = self._table
        self._live.refresh()

    def update(self, node: NodeState) -> None:
        """Draw again."""
        if self._run is not None:
            self._live.refresh()

    def _table(self) -> Any:
        from rich.table import Table

        run: GraphRun = self._run  # type: ignore[assignment]  # set before the first drawing
        table = Table(title=f"{self._graph.site}   bus at {run.endpoint}   run {run.run_id}")
        for name in ("node", "state", "pid", "in/s", "in", "out", "missed", "queue", ""):
            table.add_column(name, justify="left" if name in ("node", "state", "") else "right")
        for node in run.nodes.values():
            h = node.health
            counts = (
                [f"{h.rate_hz:.1f}", h.messages_in, h.messages_out, h.missed, h.queue_depth]
                if h
                else [""] * 5
            )
            lost = f"lost: {', '.join(h.lost_peers)} " if h and h.lost_peers else ""
            pid = str(node.process.pid) if node.process else ""
            state = f"[{_COLOURS.get(node.state, 'white')}]{node.state}[/]"
            table.add_row(node.name, state, pid, *map(str, counts), lost + node.detail)
        return table


@contextmanager
def view_of(graph: Graph, *, quiet: bool) -> Iterator[LineView | TableView]:
    """Yield the view that suits stderr: a table on a terminal, lines otherwise."""
    if quiet or not sys.stderr.isatty():
        yield LineView(quiet=quiet)
        return
    from rich.console import Console
    from rich.live import Live

    with Live(console=Console(stderr=True), refresh_per_second=4) as live:
        yield TableView(graph, live)
