"""A graph file: read, checked, and with recordings in the place of nodes if asked for."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rsenf.config.check import check
from rsenf.config.graph import Graph, completed
from rsenf.config.node_kind import NODE_KINDS, NodeKind
from rsenf.config.secrets import hide
from rsenf.config.wiring import overwriting, problems
from rsenf.config.yaml_lines import YamlText
from rsenf.errors import ConfigError, UsageError


def load_graph(path: str | Path, replayed: Mapping[str, str] | None = None) -> Graph:
    """Read and check a graph file.

    Parameters
    ----------
    path : path
        The file.
    replayed : mapping, optional
        Recordings by the names of the nodes whose place they take.

    Raises
    ------
    UsageError, ConfigError
        When it can't be read, or has problems: all of them at once.
    """
    document = YamlText(Path(path))
    graph = check(document, Graph)
    found = [*problems(graph), *_contradictions(graph, document.data)]
    if found:
        raise ConfigError([f"{document.place(at)}: {'.'.join(at)}: {t}" for at, t in found])
    return with_replayed(completed(graph), replayed or {})


def shown(graph: Graph) -> dict[str, Any]:
    """Return a graph as it was read, defaults included and secrets hidden, as plain data."""
    return dict(hide(graph.model_dump(mode="json")))


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
        nodes[name] = _player(name, nodes[name], path)
    graph = graph.model_copy(update={"nodes": nodes})
    for name, path in overwriting(graph):
        raise UsageError(f"node {name!r} would write to {path}, which is played", "rename one")
    return graph


def _player(name: str, node: NodeKind, path: str) -> NodeKind:
    """Return the node that plays what another one has sent."""
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
    """Yield settings of rows, given in the file, that a reader of the rows can't work with."""
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
