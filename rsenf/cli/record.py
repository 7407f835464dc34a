"""Write what is on a bus to an MCAP file, until Ctrl-C or for a given time.

'rsenf run' says where its bus is; a graph with a 'record' node records by itself.
"""

from __future__ import annotations

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import positive

    parser.add_argument("--connect", action="append", required=True, metavar="ENDPOINT",
                        help="of the bus, for example tcp/127.0.0.1:7447")  # fmt: skip
    parser.add_argument("--out", required=True, metavar="FILE.mcap")
    parser.add_argument("--site", default="*", help="of the graph (any)")
    parser.add_argument("--topics", action="append", metavar="KEYEXPR",
                        help="below the site, for example cam1/track (all)")  # fmt: skip
    parser.add_argument("--duration-s", type=positive, metavar="S", help="stop after this long")
    parser.add_argument("--overwrite", action="store_true")
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Record a bus."""
    import time

    from rsenf.bus.inbox import Inbox
    from rsenf.bus.keys import ROOT, health_key
    from rsenf.bus.zenoh_bus import BusSettings, open_bus
    from rsenf.cli.console import print_json, say
    from rsenf.record.writer import Recorder
    from rsenf.run.recording import DELIVERY, record_until
    from rsenf.run.signals import interruptible

    inbox, deadline = Inbox(), time.monotonic() + (args.duration_s or float("inf"))
    with (
        open_bus(BusSettings(connect=tuple(args.connect))) as bus,
        Recorder(
            args.out, run_info={"site": args.site}, clock_ns=time.time_ns, overwrite=args.overwrite
        ) as recorder,
        interruptible(lambda: None) as stop,
    ):
        for key_expr in args.topics or ["**"]:
            bus.subscribe(inbox, f"{ROOT}/{args.site}/{key_expr}", DELIVERY)
        if not args.topics:
            bus.subscribe(inbox, health_key(args.site, "*"), DELIVERY)
        say(f"recording to {args.out}; Ctrl-C ends it")
        record_until(recorder, inbox, lambda: stop.is_set() or time.monotonic() > deadline)
    c = inbox.counters
    if args.json:
        print_json({"out": args.out, "messages": c.received, "missed": c.missed,
                    "rejected": c.rejected})  # fmt: skip
    else:
        print(f"{args.out}: {c.received} messages, {c.missed} missed, {c.rejected} rejected")
    return 0
