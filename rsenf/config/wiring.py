"""What the schema of a graph can't see: whether its nodes fit together."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rsenf.bus.keys import REFERENCE, TOPICS
from rsenf.bus.zenoh_bus import setting_problem
from rsenf.config.graph import BusConfig, Graph, reader_of_frames, sender_of
from rsenf.config.hosts import host_problems
from rsenf.config.node_kind import NodeKind, Problem


def problems(graph: Graph) -> list[Problem]:
    """What doesn't fit together: where in the file, and what."""
    found = [*_of_bus(graph.bus), *host_problems(graph)]
    for name, path in overwriting(graph):
        found.append((("nodes", name, "out"), f"{path} is played by this graph"))
    for name, node in graph.nodes.items():
        of_node = [*node.problems(graph), *_twice(graph, name, node), *_unread(graph, node)]
        # With a bus of somebody else's, what is missing here may be sent there.
        if not graph.bus.is_elsewhere:
            of_node += _unfed(graph, node)
        found += [(("nodes", name, *below), text) for below, text in of_node]
    return found


def overwriting(graph: Graph) -> Iterator[tuple[str, str]]:
    """Yield the nodes that would record over what the graph plays, and where."""
    played = {Path(node.plays).resolve() for node in graph.nodes.values() if node.plays}
    for name, node in graph.nodes.items():
        if node.writes and Path(node.writes).resolve() in played:
            yield name, node.writes


def _of_bus(bus: BusConfig) -> Iterator[Problem]:
    if bus.listen and bus.is_elsewhere:
        yield ("bus", "listen"), "only a router of the run's own listens; leave out 'connect'"
    for path, value in bus.zenoh.items():
        if problem := setting_problem(path, value):
            yield ("bus", "zenoh", path), problem


def _unread(graph: Graph, node: NodeKind) -> Iterator[Problem]:
    """Yield a ring that nobody of this graph reads: its writer would wait for ever."""
    for topic, camera in node.outputs() if node.uses_ring and graph.bus.is_elsewhere else ():
        if topic == "frames" and not reader_of_frames(graph, camera):
            yield ("frames",), f"no node here reads the ring of {camera!r}; use 'tcp' or 'fused'"


def _twice(graph: Graph, name: str, node: NodeKind) -> Iterator[Problem]:
    """Yield what another node, or this one, does already."""
    sent = node.outputs()
    for topic in {stream.topic for stream in sent} - set(TOPICS):
        yield (node.named_by,), f"sends {topic!r}, which is no topic; there are {', '.join(TOPICS)}"
    for stream in dict.fromkeys(sent):
        first = sender_of(graph, *stream)
        if first != name:
            text = f"node {first!r} sends the {stream.topic} of {stream.of!r} already"
            yield (node.named_by,), text
        elif sent.count(stream) > 1:
            yield (node.named_by,), f"{stream.of!r} stands here twice"
    if node.writes:
        first = next(n for n, other in graph.nodes.items() if other.writes == node.writes)
        if first != name:
            yield ("out",), f"node {first!r} writes {node.writes} already"


def _unfed(graph: Graph, node: NodeKind) -> Iterator[Problem]:
    """Yield every input that nobody sends."""
    for (topic, of), where, _ in graph.inputs_of(node):
        if not sender_of(graph, topic, of):
            camera = "" if topic == REFERENCE else " of camera"
            yield (where,), f"nobody sends the {topic}{camera} {of!r}"
