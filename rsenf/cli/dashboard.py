"""Show all feeds of a bus on a web page, until Ctrl-C.

    rsenf dashboard --connect tcp/127.0.0.1:7447
    rsenf dashboard configs/live.yaml

It observes an existing bus and changes nothing. 'rsenf run' prints the address of its bus. A graph
file has it too, if the bus listens at a fixed address or is an existing one; it also shows which
nodes serve which feed. A graph with a 'dashboard' node shows the page by itself.
"""

from __future__ import annotations

import argparse
from pathlib import Path

POLL_S = 0.1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import add_bus_arguments

    add_bus_arguments(parser, "graph")
    parser.add_argument("--host", default="127.0.0.1", metavar="ADDRESS",
                        help="to listen at (127.0.0.1: this host alone)")  # fmt: skip
    parser.add_argument("--port", type=int, default=8780, metavar="N", help="(8780; 0: any free)")
    parser.add_argument("--archive", metavar="DIR", help="with the recordings of alarms")


def run(args: argparse.Namespace) -> int:
    """Serve the dashboard of a bus."""
    import time

    from rsenf.bus.delivery import LOOKING
    from rsenf.bus.inbox import Inbox
    from rsenf.bus.keys import ROOT, health_key
    from rsenf.bus.zenoh_bus import open_bus
    from rsenf.cli.console import bus_of, note, say
    from rsenf.config.node_kind import NODE_KINDS
    from rsenf.dashboard.server import DashboardServer, open_to_all
    from rsenf.dashboard.site import Site, Wiring, key_expressions, wiring_of
    from rsenf.errors import EXIT_DONE, UsageError
    from rsenf.run.signals import interruptible

    if not 0 <= args.port <= 65535:
        raise UsageError(f"port {args.port}: from 0 to 65535")
    settings, graph = bus_of(args)
    site = graph.site if graph else args.site
    wiring = (
        wiring_of(graph, args.archive)
        if graph
        else Wiring(archive=Path(args.archive) if args.archive else None)
    )
    topics = NODE_KINDS["dashboard"].model_fields["topics"].default
    key_exprs = [f"{ROOT}/{site}/{below}" for below in topics]
    inbox = Inbox()
    with (
        interruptible(lambda: None) as stop,
        open_bus(settings) as bus,
        Site(wiring, time.time_ns) as shown,
        DashboardServer(shown, args.host, args.port) as server,
    ):
        for key_expr in (*key_exprs, *key_expressions(wiring), health_key(site, "*")):
            bus.subscribe(inbox, key_expr, LOOKING)
        if warning := open_to_all(args.host):
            note(warning)
        say(f"{server.url}   Ctrl-C ends it")
        while not stop.is_set():
            received = inbox.receive(POLL_S)
            if received is not None:
                shown.update(received.key, received.message)
    return EXIT_DONE
