"""Check a graph file: unknown keys, wrong values, inputs that nobody sends."""

from __future__ import annotations

import argparse
import json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("graph", metavar="GRAPH.yaml")
    parser.add_argument("--json", action="store_true", help="the graph as read, as JSON")


def run(args: argparse.Namespace) -> int:
    """Check a graph."""
    from rsenf.config import load_graph, redact
    from rsenf.config.graph import outputs

    graph = load_graph(args.graph)
    if args.json:
        print(redact(json.dumps(graph.model_dump(mode="json"), indent=2)))
        return 0
    print(f"{args.graph}: fine. Site {graph.site!r}, {len(graph.nodes)} nodes:")
    for name, node in graph.nodes.items():
        sent = ", ".join(f"{topic} of {of}" for topic, of in outputs(node)) or "nothing"
        print(f"  {name:12} {node.kind:10} sends {sent}")
    return 0
