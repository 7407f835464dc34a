"""What the verbs share that look at a running bus: where it is."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.bus.zenoh_bus import BusSettings
    from rsenf.config import Graph

# Set for what a run starts; of use in a shell, too.
CONNECT = "RSENF_CONNECT"


def add_bus_arguments(parser: argparse.ArgumentParser, *graph: str) -> None:
    """Arguments that say which bus; ``graph`` spells the one that names a graph file."""
    optional = {} if graph[0].startswith("-") else {"nargs": "?"}
    parser.add_argument(*graph, metavar="GRAPH.yaml", default=None, **optional,  # type: ignore[arg-type]
                        help="whose bus it is, with its certificates")  # fmt: skip
    parser.add_argument("--as", dest="by", metavar="NAME",
                        help="whose certificate to show, where the graph has 'tls'")  # fmt: skip
    parser.add_argument("--connect", action="append", default=[], metavar="ENDPOINT",
                        help=f"of the bus, which 'rsenf run' tells (${CONNECT})")  # fmt: skip
    parser.add_argument("--site", default="*", help="to look at (any)")


def bus_of(args: argparse.Namespace) -> tuple[BusSettings, Graph | None]:
    """Return how to reach the bus, and the graph that was named.

    Raises
    ------
    UsageError
        When nothing says where it is.
    """
    from dataclasses import replace

    from rsenf.bus.zenoh_bus import BusSettings
    from rsenf.config import load_graph
    from rsenf.errors import UsageError
    from rsenf.run.access import certificates
    from rsenf.run.node import bus_settings

    told = tuple(args.connect or filter(None, [os.environ.get(CONNECT)]))
    if args.graph is None:
        if not told:
            raise UsageError("which bus?", "--connect ENDPOINT, as 'rsenf run' tells it")
        return BusSettings(connect=told), None
    graph = load_graph(args.graph)
    routers = tuple(filter(None, (host.address for host in graph.hosts.values())))
    endpoints = told or graph.bus.listen or routers
    if not (endpoints or graph.bus.is_elsewhere):
        raise UsageError(
            f"{args.graph} has a bus of its own, wherever a port was free",
            "--connect what 'rsenf run' tells, or give the graph 'bus: {listen: [...]}'",
        )
    settings = bus_settings(graph, endpoints)
    if graph.tls is None or all(endpoint.startswith("tcp/") for endpoint in endpoints):
        return settings, graph
    if args.by is None:
        raise UsageError(
            "the hosts of this graph ask for a certificate", "--as NAME: whose to show"
        )
    return replace(settings, zenoh={**certificates(graph.tls, args.by), **settings.zenoh}), graph
