"""Loads a graph file, checks what its schema can't express, and substitutes replays for nodes.

Checked are the connections between nodes (missing, duplicate or contradictory ones), and between
the hosts of a distributed graph.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rsenf.bus.keys import REFERENCE, TOPICS, matches
from rsenf.bus.zenoh_bus import setting_problem
from rsenf.config.check import YamlText, check, hide
from rsenf.config.graph import BusConfig, Graph, completed, host_of, reader_of_frames, sender_of
from rsenf.config.node_kind import NODE_KINDS, NodeKind, Problem
from rsenf.errors import ConfigError, UsageError, did_you_mean


def host_problems(graph: Graph) -> Iterator[Problem]:
    """Yield the problems of a graph's hosts, links and access rules, with their keys."""
    yield from _unsecured(graph)
    if not graph.hosts:
        return
    for key in sorted(graph.bus.model_fields_set - {"zenoh"}):
        if getattr(graph.bus, key) != BusConfig.model_fields[key].default:
            yield ("bus", key), "the hosts open routers of their own; name their 'address'"
    yield from _misplaced(graph)
    yield from _unlinked(graph)
    yield from _far_rings(graph)


def _misplaced(graph: Graph) -> Iterator[Problem]:
    for name, host in graph.hosts.items():
        for node in dict.fromkeys(host.nodes):
            if node not in graph.nodes:
                yield ("hosts", name, "nodes"), f"no node {node!r} in this graph"
            elif (first := host_of(graph, node)) != name:
                yield ("hosts", name, "nodes"), f"node {node!r} runs on host {first!r} already"
            elif host.nodes.count(node) > 1:
                yield ("hosts", name, "nodes"), f"{node!r} stands here twice"
    for node in graph.nodes:
        if not host_of(graph, node):
            yield ("nodes", node), f"runs on no host; one of {', '.join(graph.hosts)}"


def _unlinked(graph: Graph) -> Iterator[Problem]:
    for name, host in graph.hosts.items():
        for endpoint in filter(None, (host.address, *host.listen)):
            if problem := setting_problem("connect/endpoints", [endpoint]):
                yield ("hosts", name, "address"), f"{endpoint!r}: {problem}"
        for other in host.links:
            if other not in graph.hosts:
                known = ", ".join(graph.hosts)
                yield ("hosts", name, "links"), f"no host {other!r}; one of {known}"
            elif other == name or graph.hosts[other].address is None:
                yield ("hosts", name, "links"), f"host {other!r} has no address to link to"
    first = next(iter(graph.hosts))
    reached = _reached_from(graph, first)
    for name in graph.hosts:
        if name not in reached:
            yield ("hosts", name), f"no links lead from here to host {first!r}"


def _unsecured(graph: Graph) -> Iterator[Problem]:
    if graph.tls and not graph.hosts:
        yield ("tls",), "is for the links between 'hosts', and the graph has none"
    if graph.access and not graph.tls:
        yield ("access",), "nobody can be told apart without 'tls'"
    for name, host in graph.hosts.items() if graph.tls else ():
        for endpoint in filter(None, (host.address, *host.listen)):
            if not endpoint.startswith(("tls/", "quic/")):
                yield ("hosts", name, "address"), f"{endpoint!r} goes past the certificates: tls/…"
    for name, access in graph.access.items():
        for below in access.publish:
            try:
                matches(below, "any")
            except UsageError as exc:
                yield ("access", name, "publish"), str(exc)


def _reached_from(graph: Graph, first: str) -> set[str]:
    pairs = [(name, other) for name, host in graph.hosts.items() for other in host.links]
    reached, before = {first}, set[str]()
    while reached != before:
        before = set(reached)
        reached |= {n for pair in pairs if reached & set(pair) for n in pair}
    return reached


def _far_rings(graph: Graph) -> Iterator[Problem]:
    """Yield shared-memory rings whose reader runs on another host."""
    for name, node in graph.nodes.items():
        if node.uses_ring:
            for topic, camera in node.outputs():
                reader = reader_of_frames(graph, camera) if topic == "frames" else ""
                there = host_of(graph, reader)
                if there and there != host_of(graph, name):
                    text = f"node {reader!r} reads them on host {there!r}; use 'tcp' or 'fused'"
                    yield ("nodes", name, "frames"), text


def problems(graph: Graph) -> list[Problem]:
    """Return all problems between the nodes of a graph, with their keys in the file."""
    found = [*_of_bus(graph.bus), *host_problems(graph)]
    for name, path in overwriting(graph):
        found.append((("nodes", name, "out"), f"{path} is played by this graph"))
    for name, node in graph.nodes.items():
        of_node = [*node.problems(graph), *_twice(graph, name, node), *_unread(graph, node)]
        # On an existing bus, nodes outside this graph may send what is missing here.
        if not graph.bus.is_elsewhere:
            of_node += _unfed(graph, node)
        found += [(("nodes", name, *below), text) for below, text in of_node]
    return found


def overwriting(graph: Graph) -> Iterator[tuple[str, str]]:
    """Yield each node that would overwrite a file which the graph plays, with that file."""
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
    """Yield rings without a reader in this graph: their writer would block for ever."""
    for topic, camera in node.outputs() if node.uses_ring and graph.bus.is_elsewhere else ():
        if topic == "frames" and not reader_of_frames(graph, camera):
            yield ("frames",), f"no node here reads the ring of {camera!r}; use 'tcp' or 'fused'"


def _twice(graph: Graph, name: str, node: NodeKind) -> Iterator[Problem]:
    """Yield outputs and files that a node duplicates, and outputs that are no topics."""
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
    """Yield the inputs that no node sends."""
    for (topic, of), where, _ in graph.inputs_of(node):
        if not sender_of(graph, topic, of):
            camera = "" if topic == REFERENCE else " of camera"
            yield (where,), f"nobody sends the {topic}{camera} {of!r}"


def load_graph(path: str | Path, replayed: Mapping[str, str] | None = None) -> Graph:
    """Read and check a graph file.

    Parameters
    ----------
    path : path
    replayed : mapping, optional
        Paths of recordings, by the names of the nodes that they replace.

    Raises
    ------
    UsageError, ConfigError
        When it can't be read, or has problems, all of which are listed.
    """
    document = YamlText(Path(path))
    graph = check(document, Graph)
    found = [*problems(graph), *_contradictions(graph, document.data)]
    if found:
        raise ConfigError([f"{document.place(at)}: {'.'.join(at)}: {t}" for at, t in found])
    graph = with_replayed(completed(graph), replayed or {})
    graph.hold_environment()
    return graph


def shown(graph: Graph) -> dict[str, Any]:
    """Return a graph as plain data, including defaults, with secrets redacted."""
    return dict(hide(graph.model_dump(mode="json")))


def with_replayed(graph: Graph, recordings: Mapping[str, str]) -> Graph:
    """Return a graph in which some nodes are replaced by replays of their recorded output.

    Parameters
    ----------
    graph : Graph
    recordings : mapping
        Path of a recording, by the name of the node that it replaces.

    Raises
    ------
    UsageError
        When there is no such node, it sends nothing, or the graph would write to the recording.
    """
    nodes = dict(graph.nodes)
    for name, path in recordings.items():
        if name not in nodes:
            hint = did_you_mean(name, nodes) or f"there is: {', '.join(nodes)}"
            raise UsageError(f"no node {name!r} to replay", hint)
        nodes[name] = _player(name, nodes[name], path)
    graph = graph.model_copy(update={"nodes": nodes})
    for name, path in overwriting(graph):
        raise UsageError(f"node {name!r} would write to {path}, which is played", "rename one")
    return graph


def _player(name: str, node: NodeKind, path: str) -> NodeKind:
    """Return a replay node for the outputs of a node."""
    sent = node.outputs()
    if not sent:
        raise UsageError(f"node {name!r} sends nothing that could be replayed")
    settings = {
        "kind": "replay",
        "input": path,
        "topics": tuple(map(str, sent)),
        "frames": "tcp" if getattr(node, "frames", "") == "tcp" else "ring",
    }
    return NODE_KINDS["replay"](**settings)


def _contradictions(graph: Graph, data: Any) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield row settings given in the file that contradict what a reader of the rows needs."""
    for reader, node in graph.nodes.items():
        for field, value in node.rows_needed().items():
            for camera in node.feeds:
                for name, sender in graph.nodes.items():
                    given = data["nodes"][name].get("rows") or {}
                    sends = ("rows", camera) in sender.outputs() and field in given
                    rows = getattr(sender, "rows", None)
                    if sends and getattr(rows, field, value) != value:
                        text = f"node {reader!r} needs {field} {str(value).lower()}"
                        yield ("nodes", name, "rows", field), text
