"""A graph in which recordings take the place of nodes."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from pathlib import Path

from rsenf.bus.keys import REFERENCE
from rsenf.config.graph import Graph, outputs
from rsenf.config.node_kinds import RecordNode, ReplayNode
from rsenf.errors import UsageError


def with_replayed(graph: Graph, recordings: Mapping[str, str]) -> Graph:
    """Return a graph in which some nodes' output is played instead of made.

    Parameters
    ----------
    graph : Graph
        The graph.
    recordings : mapping
        Path of a recording by the name of the node that it replaces.

    Raises
    ------
    UsageError
        When there is no such node, it sends nothing, or the graph would write to the recording.
    """
    nodes = dict(graph.nodes)
    for name, path in recordings.items():
        if name not in nodes:
            close = difflib.get_close_matches(name, nodes, n=1, cutoff=0.5)
            hint = f"did you mean {close[0]!r}?" if close else f"there is: {', '.join(nodes)}"
            raise UsageError(f"no node {name!r} to replay", hint)
        sent = outputs(nodes[name])
        if not sent:
            raise UsageError(f"node {name!r} sends nothing that could be replayed")
        topics = tuple(f"{t}/{of}" if t == REFERENCE else f"{of}/{t}" for t, of in sent)
        frames = getattr(nodes[name], "frames", "ring")
        nodes[name] = ReplayNode(
            kind="replay",
            input=path,
            topics=topics,
            frames="tcp" if frames == "tcp" else "ring",
        )
    graph = graph.model_copy(update={"nodes": nodes})
    for name, node in overwriting(graph):
        raise UsageError(f"node {name!r} would write to {node.out}, which is played", "rename one")
    return graph


def overwriting(graph: Graph) -> Iterator[tuple[str, RecordNode]]:
    """Yield the nodes that would record over what the graph plays, and their names."""
    played = {Path(node.input).resolve() for node in graph.of(ReplayNode)}
    for name, node in graph.nodes.items():
        if isinstance(node, RecordNode) and node.out and Path(node.out).resolve() in played:
            yield name, node
