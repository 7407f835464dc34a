"""Check a graph file: unknown keys, wrong values, inputs without a sender, replayed recordings."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.config import Graph


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("graph", metavar="GRAPH.yaml")
    parser.add_argument("--json", action="store_true", help="the graph as read, as JSON")


def run(args: argparse.Namespace) -> int:
    """Check a graph."""
    from rsenf.config import load_graph, redact
    from rsenf.config.graph import host_of

    graph = load_graph(args.graph)
    _check_recordings(graph)
    if args.json:
        print(redact(json.dumps(graph.model_dump(mode="json"), indent=2)))
        return 0
    print(f"{args.graph}: fine. Site {graph.site!r}, {len(graph.nodes)} nodes:")
    for name, node in graph.nodes.items():
        sent = ", ".join(f"{topic} of {of}" for topic, of in node.outputs()) or "nothing"
        where = f"on {host_of(graph, name)}: " if graph.hosts else ""
        print(f"  {name:12} {node.kind:10} {where}sends {sent}")
    return 0


def _check_recordings(graph: Graph) -> None:
    """Check the recordings that a graph replays; a missing one may still be made later."""
    from rsenf.cli.console import note

    for name, node in graph.nodes.items():
        if node.plays and not Path(node.plays).exists():
            note(f"node {name!r} plays {node.plays}, which isn't there: not checked")
        else:
            node.check_ready(name, graph.site)
