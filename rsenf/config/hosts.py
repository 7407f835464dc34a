"""Whether a graph that is split over hosts holds together."""

from __future__ import annotations

from collections.abc import Iterator

from rsenf.bus.keys import matches
from rsenf.bus.zenoh_bus import setting_problem
from rsenf.config.graph import BusConfig, Graph, host_of
from rsenf.config.graph import reader_of_frames as reader_of
from rsenf.config.node_kind import Problem
from rsenf.errors import UsageError


def host_problems(graph: Graph) -> Iterator[Problem]:
    """Yield where in the file something doesn't fit, and what."""
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
    """Yield rings in shared memory that are to be read on another host."""
    for name, node in graph.nodes.items():
        if node.uses_ring:
            for topic, camera in node.outputs():
                reader = reader_of(graph, camera) if topic == "frames" else ""
                there = host_of(graph, reader)
                if there and there != host_of(graph, name):
                    text = f"node {reader!r} reads them on host {there!r}; use 'tcp' or 'fused'"
                    yield ("nodes", name, "frames"), text
