"""What the schema of a graph can't see: whether its nodes fit together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rsenf.bus.keys import REFERENCE, matches, reference_key
from rsenf.bus.zenoh_bus import setting_problem
from rsenf.config.graph import BusConfig, Graph, outputs, reader_of_frames, sender_of
from rsenf.config.hosts import Problem, host_problems
from rsenf.config.node_kinds import (
    DashboardNode,
    DecodeNode,
    DiscoverNode,
    FoxgloveNode,
    IdleNode,
    LiveNode,
    MatchNode,
    Node,
    RecordNode,
    ReferenceNode,
    ReplayNode,
    RowsNode,
    TrackNode,
)
from rsenf.config.replayed import overwriting
from rsenf.errors import UsageError
from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.match import METHODS as MATCH_METHODS
from rsenf.match import tracker_for
from rsenf.track import METHODS as TRACK_METHODS

_READS = {"rows": "frames", "track": "rows", "idle": "rows", "discover": "rows", "match": "track"}


def problems(graph: Graph) -> list[Problem]:
    """What doesn't fit together: where in the file, and what."""
    found = [*_of_bus(graph.bus), *host_problems(graph)]
    for name, recorder in overwriting(graph):
        found.append((("nodes", name, "out"), f"{recorder.out} is played by this graph"))
    for name, node in graph.nodes.items():
        at = ("nodes", name)
        found += [((*at, *below), text) for below, text in _of_node(node)]
        found += [((*at, where), text) for where, text in _twice(graph, name, node)]
        found += [((*at, where), text) for where, text in _unread(graph, node)]
        found += [((*at, where), text) for where, text in _unfit(graph, node)]
        found += [((*at, where), text) for where, text in _own_judge(graph, node)]
        if isinstance(node, ReferenceNode):
            found += [((*at, *below), text) for below, text in _of_reference(graph, node)]
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
    if (
        isinstance(node, TrackNode | IdleNode)
        and node.idle
        and node.idle.method not in IDLE_METHODS
    ):
        yield ("idle", "method"), _no_method(node.idle.method, IDLE_METHODS)
    if isinstance(node, MatchNode) and node.method not in MATCH_METHODS:
        yield ("method",), _no_method(node.method, MATCH_METHODS)
    if isinstance(node, ReplayNode) and node.end_s is not None and node.end_s <= node.start_s:
        yield ("end_s",), f"{node.end_s:g} s isn't after start_s, {node.start_s:g} s"
    if isinstance(node, RecordNode):
        yield from _of_record(node)
    if isinstance(node, FoxgloveNode | DashboardNode):
        yield from _key_expressions(("topics", key_expr) for key_expr in node.topics)


def _of_reference(graph: Graph, node: ReferenceNode) -> Iterator[Problem]:
    if node.follow and (node.feed[0] != "file" or node.input.startswith("store:")):
        yield ("follow",), f"{node.input} is no file that grows"
    if node.feed == ("topic", reference_key(graph.site, node.grid)):
        yield ("input",), "that is this node's own topic"


def _of_record(node: RecordNode) -> Iterator[Problem]:
    named = [("topics", key_expr) for key_expr in node.topics]
    yield from _key_expressions([*named, ("alarms", node.alarms.trigger)])
    if (node.out is None) == (node.archive is None):
        yield (), "name a file with 'out', or a folder with 'archive': one of the two"
    for key in ("rotation", "retention", "alarms"):
        if node.out is not None and key in node.model_fields_set:
            yield (key,), f"{key} is of an archive; name a folder with 'archive', not a file"


def _key_expressions(named: Iterable[tuple[str, str]]) -> Iterator[Problem]:
    for where, key_expr in named:
        try:
            matches(key_expr, "any")
        except UsageError as exc:
            yield (where,), str(exc)


def _no_method(read: str, known: Iterable[str]) -> str:
    return f"no method {read!r}; one of {', '.join(known)}"


def _unread(graph: Graph, node: Node) -> Iterator[tuple[str, str]]:
    """Yield a ring that nobody of this graph reads: its writer would wait for ever."""
    if not isinstance(node, DecodeNode | ReplayNode) or not graph.bus.is_elsewhere:
        return
    for topic, camera in outputs(node) if node.frames == "ring" else ():
        if topic == "frames" and not reader_of_frames(graph, camera):
            yield "frames", f"no node here reads the ring of {camera!r}; use 'tcp' or 'fused'"


def _twice(graph: Graph, name: str, node: Node) -> Iterator[tuple[str, str]]:
    """Yield what another node, or this one, does already."""
    for topic, of in dict.fromkeys(outputs(node)):
        first = sender_of(graph, topic, of)
        where = _named_in(node)
        if first != name:
            yield where, f"node {first!r} sends the {topic} of {of!r} already"
        elif outputs(node).count((topic, of)) > 1:
            yield where, f"{of!r} stands here twice"
    if isinstance(node, RecordNode) and node.out is not None:
        writers = [n for n, other in graph.nodes.items() if getattr(other, "out", "") == node.out]
        if writers[0] != name:
            yield "out", f"node {writers[0]!r} writes {node.out} already"


def _named_in(node: Node) -> str:
    """Return the key of a node that says what it sends."""
    kinds = {"reference": "grid", "decode": "camera", "replay": "topics", "external": "sends"}
    return kinds.get(node.kind, "cameras")


def _unfit(graph: Graph, node: Node) -> Iterator[tuple[str, str]]:
    """Yield a matcher that can do nothing with the ENF it is sent."""
    if not isinstance(node, MatchNode) or not (needed := tracker_for(node.method)):
        return
    for camera in node.cameras:
        sender = graph.nodes.get(sender_of(graph, "track", camera))
        if isinstance(sender, TrackNode) and sender.track.method != needed:
            other = sender.track.method
            yield "method", f"{node.method} needs the ENF method {needed!r}, not {other!r}"


def _own_judge(graph: Graph, node: Node) -> Iterator[tuple[str, str]]:
    """Yield a camera that is compared with itself: it would fit, whatever it shows."""
    if not isinstance(node, MatchNode | LiveNode):
        return
    sender = graph.nodes.get(sender_of(graph, REFERENCE, node.grid))
    if isinstance(sender, ReferenceNode) and sender.feed in {("camera", c) for c in node.cameras}:
        yield "cameras", f"the reference {node.grid!r} is {sender.feed[1]!r}, compared with itself"


def _unfed(graph: Graph, node: Node) -> Iterator[tuple[str, str]]:
    """Yield every input that nobody sends."""
    if isinstance(node, RowsNode | TrackNode | IdleNode | DiscoverNode | MatchNode):
        topic = _READS[node.kind]
        for camera in node.cameras:
            if not sender_of(graph, topic, camera):
                yield "cameras", f"nobody sends the {topic} of camera {camera!r}"
    if isinstance(node, LiveNode):
        for camera, topic in ((c, t) for c in node.cameras for t in ("rows", "track")):
            if not sender_of(graph, topic, camera):
                yield "cameras", f"nobody sends the {topic} of camera {camera!r}"
    if isinstance(node, MatchNode | LiveNode) and not sender_of(graph, "reference", node.grid):
        yield "grid", f"nobody sends the reference {node.grid!r}"
    if isinstance(node, ReferenceNode) and node.feed[0] == "camera":
        camera = node.feed[1]
        if not sender_of(graph, "track", camera):
            yield "input", f"nobody sends the track of camera {camera!r}"
