"""List the topics of a bus, print their messages, measure their rates.

    rsenf topic list --connect tcp/127.0.0.1:7447
    rsenf topic echo 'cam1/track' --connect tcp/127.0.0.1:7447 --count 5
    rsenf topic hz '*/rows' --graph GRAPH.yaml

Topics are key expressions below the site. 'echo' prints one JSON object per line until Ctrl-C;
times in ns are strings, unknown values are null, pictures and long arrays are shown by their size
only. It exerts no backpressure: messages that come too fast are dropped, and counted.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.bus.inbox import Inbox, Received

HEAD = ("topic", "message", "messages", "Hz", "kB/s", "longest gap s")
POLL_S = 0.2
LONGEST = 16  # longest array that is printed in full


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import add_bus_arguments
    from rsenf.cli.options import count, positive

    parser.add_argument("do", choices=("list", "echo", "hz"))
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help="such as cam1/track (all)")
    add_bus_arguments(parser, "--graph")
    parser.add_argument("--for-s", type=positive, metavar="S",
                        help="look for (list 2, hz 5, echo until Ctrl-C)")  # fmt: skip
    parser.add_argument("--count", type=count, default=0, metavar="N", help="echo so many (all)")
    parser.add_argument("--arrays", action="store_true", help="echo long arrays whole")
    parser.add_argument("--history", action="store_true", help="echo what was sent lately first")
    parser.add_argument("--json", action="store_true", help="as JSON; echo always is")


def run(args: argparse.Namespace) -> int:
    """List, print or measure the topics."""
    from rsenf.bus.delivery import LOOKING
    from rsenf.bus.inbox import Inbox
    from rsenf.bus.keys import ROOT, health_key
    from rsenf.bus.zenoh_bus import open_bus
    from rsenf.cli.console import aligned, bus_of, note, print_json
    from rsenf.run.rates import LIVE_ONLY, Rates

    settings, graph = bus_of(args)
    site = graph.site if graph else args.site
    named = [f"{ROOT}/{site}/{topic}" for topic in args.topics or ["**"]]
    health = [] if args.topics or args.do == "echo" else [health_key(site, "*")]
    with_history = args.do == "list" or args.history
    inbox, rates = Inbox(), Rates(time.monotonic())
    for_s = args.for_s or {"list": 2.0, "hz": 5.0}.get(args.do, float("inf"))
    with open_bus(settings) as bus:
        for key_expr in (*named, *health):
            bus.subscribe(inbox, key_expr, LOOKING if with_history else LIVE_ONLY)
        for number, received in enumerate(_received(inbox, for_s), 1):
            rates.note(received, time.monotonic())
            if args.do == "echo":
                print(_line(received, None if args.arrays else LONGEST), flush=True)
                if number == args.count:
                    break
    found = rates.found(time.monotonic())
    if args.do == "echo":
        pass
    elif args.json:
        print_json([rate.as_json() for rate in found])
    elif not found:
        note("nothing was sent")
    elif args.do == "list":
        print("\n".join(f"{rate.key}  {rate.message}" for rate in found))
    else:
        print(aligned([HEAD, *(rate.line() for rate in found)]))
    counters = inbox.counters
    if counters.dropped or counters.rejected:
        note(f"{counters.dropped} dropped here, {counters.rejected} none of rsenf's, or broken")
    return 0


def _received(inbox: Inbox, for_s: float) -> Iterator[Received]:
    """Yield messages for a number of seconds."""
    deadline = time.monotonic() + for_s
    while (remaining_s := deadline - time.monotonic()) > 0:
        received = inbox.receive(min(remaining_s, POLL_S))
        if received is not None:
            yield received


def _line(received: Received, longest: int | None) -> str:
    from rsenf.messages.codec import plain

    shown = {"topic": received.key, "message": type(received.message).__name__}
    return json.dumps(shown | plain(received.message, longest), allow_nan=False, ensure_ascii=False)
