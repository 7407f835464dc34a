"""What the schema of a graph can't see: whether its nodes fit together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rsenf.bus.keys import matches
from rsenf.bus.zenoh_bus import setting_problem
from rsenf.config.graph import (
    BusConfig,
    DecodeNode,
    DiscoverNode,
    FoxgloveNode,
    Graph,
    IdleNode,
    MatchNode,
    Node,
    RecordNode,
    RowsNode,
    TrackNode,
    outputs,
    sender_of,
)
from rsenf.errors import UsageError
from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.match import METHODS as MATCH_METHODS
from rsenf.match import tracker_for
from rsenf.track import METHODS as TRACK_METHODS

Problem = tuple[tuple[str, ...], str]

_READS = {"rows": "frames", "track": "rows", "idle": "rows", "discover": "rows", "match": "track"}


def problems(graph: Graph) -> list[Problem]:
    """What doesn't fit together: where in the file, and what."""
    found = list(_of_bus(graph.bus))
    for name, node in graph.nodes.items():
        at = ("nodes", name)
        found += [((*at, *below), text) for below, text in _of_node(node)]
        found += [((*at, where), text) for where, text in _twice(graph, name, node)]
        found += [((*at, where), text) for where, text in _unread(graph, node)]
        found += [((*at, where), text) for where, text in _unfit(graph, node)]
        # With a bus of somebody else's, what is missing here may be sent there.
        if not graph.bus.is_elsewhere:
            found += [((*at, where), text) for where, text in _unfed(graph, node)]
    return found


def _of_bus(bus: BusConfig) -> Iterator[Problem]:
    if bus.listen and bus.is_elsewhere:
        yield ("bus", "listen"), "only a router of the run's own listens; leave out 'connect'"
    for path, value in bus.zenoh.items():
        if problem := setting_problem(path, value):
            yield ("bus", "zenoh", path), problem


def _of_node(node: Node) -> Iterator[Problem]:
    if isinstance(node, TrackNode) and node.track.method not in TRACK_METHODS:
        yield ("track", "method"), _no_method(node.track.method, TRACK_METHODS)
    if isinstance(node, IdleNode) and node.idle.method not in IDLE_METHODS:
        yield ("idle", "method"), _no_method(node.idle.method, IDLE_METHODS)
    if isinstance(node, MatchNode) and node.method not in MATCH_METHODS:
        yield ("method",), _no_method(node.method, MATCH_METHODS)
    if isinstance(node, RecordNode | FoxgloveNode):
        for key_expr in node.topics:
            try:
                matches(key_expr, "any")
            except UsageError as exc:
                yield ("topics",), str(exc)


def _no_method(read: str, known: Iterable[str]) -> str:
    return f"no method {read!r}; one of {', '.join(known)}"


def _unread(graph: Graph, node: Node) -> Iterator[tuple[str, str]]:
    """Yield a ring that nobody of this graph reads: its writer would wait for ever."""
    if isinstance(node, DecodeNode) and node.frames == "ring" and graph.bus.is_elsewhere:
        reader = sender_of(graph, "rows", node.camera)
        if not reader:
            yield "frames", f"no node here reads the ring of {node.camera!r}; use 'tcp' or 'fused'"


def _twice(graph: Graph, name: str, node: Node) -> Iterator[tuple[str, str]]:
    """Yield what another node, or this one, does already."""
    for topic, of in dict.fromkeys(outputs(node)):
        first = sender_of(graph, topic, of)
        where = "grid" if topic == "reference" else "cameras" if node.kind != "decode" else "camera"
        if first != name:
            yield where, f"node {first!r} sends the {topic} of {of!r} already"
        elif outputs(node).count((topic, of)) > 1:
            yield where, f"{of!r} stands here twice"
    if isinstance(node, RecordNode):
        writers = [n for n, other in graph.nodes.items() if getattr(other, "out", "") == node.out]
        if writers[0] != name:
            yield "out", f"node {writers[0]!r} writes {node.out} already"


def _unfit(graph: Graph, node: Node) -> Iterator[tuple[str, str]]:
    """Yield a matcher that can do nothing with the ENF it is sent."""
    if not isinstance(node, MatchNode) or not (needed := tracker_for(node.method)):
        return
    for camera in node.cameras:
        sender = graph.nodes.get(sender_of(graph, "track", camera))
        if isinstance(sender, TrackNode) and sender.track.method != needed:
            other = sender.track.method
            yield "method", f"{node.method} needs the ENF method {needed!r}, not {other!r}"


def _unfed(graph: Graph, node: Node) -> Iterator[tuple[str, str]]:
    """Yield every input that nobody sends."""
    if isinstance(node, RowsNode | TrackNode | IdleNode | DiscoverNode | MatchNode):
        topic = _READS[node.kind]
        for camera in node.cameras:
            if not sender_of(graph, topic, camera):
                yield "cameras", f"nobody sends the {topic} of camera {camera!r}"
    if isinstance(node, MatchNode) and not sender_of(graph, "reference", node.grid):
        yield "grid", f"nobody sends the reference {node.grid!r}"
