"""Views of a running graph: a table on a terminal, or a log of events (text or JSON lines)."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rsenf.config import Graph
from rsenf.config.graph import source_waits
from rsenf.messages import Alarm, DiscoveryVerdict, Liveness, MatchResult
from rsenf.run import log
from rsenf.run.restart_policy import HANGS, WENT_WRONG

if TYPE_CHECKING:
    from rich.table import Table

    from rsenf.config.node_kind import NodeKind
    from rsenf.messages import Health
    from rsenf.run.graph_run import GraphRun
    from rsenf.run.restart_policy import NodeState

SUMMARY_S = 3600.0
ALARM_LEVELS = {"info": "info", "warning": "warning", "alarm": "error"}
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


def alarm_line(graph: Graph, alarm: Alarm) -> str:
    """Return an alarm on one line: by the host's clock, or the stream's where that is a file's."""
    return alarm.line(by_host=not source_waits(graph, alarm.header.source.partition("/")[2]))


class EventView:
    """A log of events, for people and log collectors: one line each, as text or as JSON.

    Events are changes of a node's state, changes of a feed's verdict, and alarms as they begin and
    end. Every hour a summary follows.

    Parameters
    ----------
    graph : Graph
    quiet : bool
        Only failures and alarms.
    as_json : bool, optional
        JSON lines (:func:`rsenf.run.log.line`).

    Attributes
    ----------
    reported : dict
        The last detail printed of each node.
    """

    def __init__(self, graph: Graph, *, quiet: bool, as_json: bool = False) -> None:
        self._graph, self._quiet, self._as_json = graph, quiet, as_json
        self._begun = time.monotonic()
        self._summary_due_s = SUMMARY_S
        self._run: GraphRun | None = None
        self._states: dict[str, str] = {}
        self._behind: dict[str, str] = {}
        self._alarms: dict[str, Alarm] = {}
        self.reported: dict[str, str] = {}
        self._verdicts: dict[tuple[str, str], tuple[str, ...]] = {}

    def started(self, run: GraphRun) -> None:
        """Print the address of the bus, and follow the run's results."""
        self._run, run.on_result = run, self.result
        self._event("info", f"bus at {run.endpoint}, run {run.run_id}")

    def update(self, node: NodeState) -> None:
        """Print a node's new state or detail; not a detail that is its newest result in short.

        And that it is behind, or has caught up.
        """
        if self._behind.get(node.name, "") != node.behind:
            self._behind[node.name] = node.behind
            level, text = ("warning", node.behind) if node.behind else ("info", "caught up")
            self._event(level, text, node=node.name, camera=", ".join(self._cameras_of(node)))
            return
        goes_on = self._states.get(node.name) == node.state == "running"
        config = self._nodes.get(node.name)
        if goes_on and config and any(stage.shown for stage in config.stages()):
            return
        self._states[node.name] = node.state
        level = "warning" if node.state in ("restarting", *HANGS) else "info"
        pid = f" pid {node.process.pid}" if node.process and node.state == "running" else ""
        always = node.state in (*WENT_WRONG, *HANGS)
        is_new = always or self.reported.get(node.name) != node.detail
        if always or not self._quiet:
            self.reported[node.name] = node.detail
        self._event(
            "error" if node.went_wrong else level,
            f"{node.state}{pid} {node.detail if is_new else ''}".rstrip(),
            node=node.name,
            camera=", ".join(self._cameras_of(node)),
            always=always,
        )

    def result(self, source: str, message: Any) -> None:
        """Print an alarm, or a verdict that has changed; a summary when one is due."""
        if isinstance(message, Alarm):
            level = ALARM_LEVELS.get(message.severity, "warning") if message.active else "info"
            graph = self._run.graph if self._run else self._graph
            self._event(level, alarm_line(graph, message), camera=source, always=True)
            self._alarms[source] = message
        elif verdict := _verdict(message):
            key = type(message).__name__, source
            alarm = self._alarms.get(source)
            is_alarm = alarm and alarm.active and message.in_short == f"{alarm.kind}: {alarm.text}"
            if self._verdicts.get(key) != verdict and not is_alarm:
                self._event("info", message.in_short, camera=source)
            self._verdicts[key] = verdict
        if time.monotonic() - self._begun >= self._summary_due_s:
            self._summary_due_s += SUMMARY_S
            assert self._run is not None
            self._summarise(self._run)

    def _summarise(self, run: GraphRun) -> None:
        """Print how many feeds have each verdict, the alarms so far, and nodes that don't run."""
        of_feeds = (v for (kind, _), v in self._verdicts.items() if kind == Liveness.__name__)
        count = Counter(verdict for (verdict,) in of_feeds)
        feeds = ", ".join(f"{count[verdict]} {verdict}" for verdict in sorted(count))
        nodes, alarms = run.nodes.values(), run.alarm_counts.total()
        missed = sum(node.health.missed for node in nodes if node.health)
        away = ", ".join(f"{n.name} {n.state}" for n in nodes if n.state not in ("running", "done"))
        parts = [feeds and f"feeds: {feeds}", f"alarms: {alarms}", f"missed: {missed}", away]
        self._event("info", "; ".join(filter(None, parts)))

    def _cameras_of(self, node: NodeState) -> list[str]:
        if node.kind == "reference" or not self._as_json:  # a grid is no camera
            return []
        config = self._nodes.get(node.name)
        return list(dict.fromkeys(camera for _, camera in config.outputs())) if config else []

    @property
    def _nodes(self) -> Mapping[str, NodeKind]:
        """The nodes of the present graph: a reload exchanges it."""
        return (self._run.graph if self._run else self._graph).nodes

    def _event(
        self, level: str, text: str, *, node: str = "", camera: str = "", always: bool = False
    ) -> None:
        if self._quiet and not always:
            return
        if self._as_json:
            shown = log.line(level, text, node=node, camera=camera.rpartition("/")[2])
        else:
            of = f"{node or camera}: " if node or camera else ""
            shown = f"rsenf {time.monotonic() - self._begun:6.2f} s  {of}{text}"
        print(shown, file=sys.stderr, flush=True)


def _verdict(message: object) -> tuple[str, ...]:
    """Return what is told when it changes: a verdict, and the effects found; empty for none."""
    if isinstance(message, Liveness):
        return (message.verdict,)
    if isinstance(message, MatchResult):
        return (message.decision,)
    if isinstance(message, DiscoveryVerdict):
        return (message.verdict, *(e.name or " or ".join(e.members) for e in message.effects))
    return ()


class TableView:
    """A table on a terminal, redrawn in place."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._run: GraphRun | None = None
        self.reported: dict[str, str] = {}  # none for good
        self.refresh: Callable[[], None] = lambda: None

    def started(self, run: GraphRun) -> None:
        """Draw for the first time."""
        self._run = run
        self.refresh()

    def update(self, node: NodeState) -> None:
        """Draw again."""
        self.refresh()

    def __rich__(self) -> Table | str:
        return _table(self._run.graph, self._run) if self._run else ""


def _table(graph: Graph, run: GraphRun) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(f"{graph.site}   bus at {run.endpoint}   run {run.run_id}"))
    for name in ("node", "state", "pid", *_COUNTS, ""):
        table.add_column(name, justify="left" if name in ("node", "state", "") else "right")
    for node in list(run.nodes.values()):
        report = node.health
        counts = [str(count(report)) if report else "" for count in _COUNTS.values()]
        lost = f"lost: {', '.join(report.lost_peers)} " if report and report.lost_peers else ""
        pid = str(node.process.pid) if node.process else ""
        state = f"[{_COLOURS.get(node.state, 'white')}]{node.state}[/]"
        behind = f"{node.behind} " if node.behind else ""
        table.add_row(node.name, state, pid, *counts, escape(lost + behind + node.detail))
    return table


@contextmanager
def view_of(graph: Graph, *, quiet: bool) -> Iterator[EventView | TableView]:
    """Yield the view that suits stderr: JSON if asked for, a table on a terminal, or else lines."""
    if quiet or log.is_json() or not sys.stderr.isatty():
        yield EventView(graph, quiet=quiet, as_json=log.is_json())
        return
    from rich.console import Console
    from rich.live import Live

    view = TableView(graph)
    with Live(view, console=Console(stderr=True), refresh_per_second=4) as live:
        view.refresh = live.refresh
        yield view
