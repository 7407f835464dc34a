"""Verbs that look at a bus: its nodes, its topics, and all feeds on a page."""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rsenf.cli.console import add_bus_arguments, aligned, bus_of, note, print_json, say
from rsenf.cli.options import count, positive
from rsenf.errors import EXIT_DONE, RsenfError, UsageError

if TYPE_CHECKING:
    from rsenf.bus.inbox import Inbox, Received
    from rsenf.run.roster import Roster, Seen


NODES = """\
List the nodes on a bus, and their states.

    rsenf nodes --connect tcp/127.0.0.1:7447
    rsenf nodes GRAPH.yaml
    rsenf nodes GRAPH.yaml --wait-s 60 && rsenf topic hz --graph GRAPH.yaml

States are those that nodes report, and: 'silent', present without health messages (it hangs);
'lost', gone without a last message; 'absent', in the graph but never seen. Latency is the median
and the 95th percentile of the last minute: 'arrival', since the picture arrived at the host, and
'exposure', since it was taken by the camera's clock, if the stream has that time."""


HEAD = ("node", "kind", "state", "in/s", "arrival s", "exposure s", "queue", "dropped", "missed",
        "rejected", "again", "heard s", "MB", "")  # fmt: skip


def add_nodes(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    add_bus_arguments(parser, "graph")
    parser.add_argument("--for-s", type=positive, default=1.5, metavar="S", help="look for (1.5)")
    parser.add_argument("--wait-s", type=positive, metavar="S",
                        help="look until all run or are done; if not by then, fail")  # fmt: skip
    parser.add_argument("--json", action="store_true")


def run_nodes(args: argparse.Namespace) -> int:
    """List the nodes."""
    roster = _waited_for(args) if args.wait_s else _look(args)
    now_s, now_ns = time.monotonic(), time.time_ns()
    lines = [_line(seen, now_s, now_ns) for seen in roster.nodes()]
    if args.json:
        print_json(roster.as_json())
    elif lines:
        print(aligned([HEAD, *lines]))
    else:
        note("no node on this bus")
    return 0


def _look(args: argparse.Namespace) -> Roster:
    """Listen for a while; return what was seen."""
    from rsenf.bus.zenoh_bus import open_bus
    from rsenf.run.roster import Roster

    settings, site, graph = bus_of(args)
    with open_bus(settings) as bus:
        roster = Roster(bus, site)
        if graph:
            roster.expect(graph.site, graph.nodes)
        deadline = time.monotonic() + args.for_s
        while (remaining_s := deadline - time.monotonic()) > 0:
            roster.listen(remaining_s)
    return roster


def _waited_for(args: argparse.Namespace) -> Roster:
    """Wait until every node is up. The time limit is extended on a slow machine."""
    from rsenf.run.process import PAUSE_S, Patience

    patience = Patience(args.wait_s)
    while True:
        try:
            roster = _look(args)
            if not (down := roster.down()):
                return roster
            raise RsenfError(", ".join(down))
        except RsenfError as exc:
            if isinstance(exc, UsageError) or patience.over:
                raise
            time.sleep(PAUSE_S)


def _line(seen: Seen, now_s: float, now_ns: int) -> tuple[str, ...]:
    """Return the cells of a node, in the order of ``HEAD``."""
    health = seen.health
    if health is None:
        return (f"{seen.site}/{seen.name}", "", seen.state(now_s))
    heard_s = (now_ns - health.last_input_ns) / 1e9
    return (
        f"{seen.site}/{seen.name}",
        health.kind,
        seen.state(now_s),
        f"{health.rate_hz:.1f}",
        _late(health.latency_p50_s, health.latency_p95_s),
        _late(health.exposure_p50_s, health.exposure_p95_s),
        str(health.queue_depth),
        str(health.dropped),
        str(health.missed),
        str(health.rejected),
        str(health.restarts),
        f"{heard_s:.1f}" if health.last_input_ns else "never",
        f"{health.memory_bytes / 1e6:.0f}",
        health.detail,
    )


def _late(median_s: float, p95_s: float) -> str:
    return "–" if math.isnan(median_s) else f"{median_s:.2f} / {p95_s:.2f}"


TOPIC = """\
List the topics of a bus, print their messages, measure their rates.

    rsenf topic list --connect tcp/127.0.0.1:7447
    rsenf topic echo 'cam1/track' --connect tcp/127.0.0.1:7447 --count 5
    rsenf topic hz '*/rows' --graph GRAPH.yaml

Topics are key expressions below the site. 'echo' prints one JSON object per line until Ctrl-C;
times in ns are strings, unknown values are null, pictures and long arrays are shown by their size
only. It exerts no backpressure: messages that come too fast are dropped, and counted."""


TOPIC_HEAD = ("topic", "message", "messages", "Hz", "kB/s", "longest gap s")
TOPIC_POLL_S = 0.2
LONGEST = 16  # longest array that is printed in full


def add_topic(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("do", choices=("list", "echo", "hz"))
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help="such as cam1/track (all)")
    add_bus_arguments(parser, "--graph")
    parser.add_argument("--for-s", type=positive, metavar="S",
                        help="look for (list 2, hz 5, echo until Ctrl-C)")  # fmt: skip
    parser.add_argument("--count", type=count, default=0, metavar="N", help="echo so many (all)")
    parser.add_argument("--arrays", action="store_true", help="echo long arrays whole")
    parser.add_argument("--history", action="store_true", help="echo what was sent lately first")
    parser.add_argument("--json", action="store_true", help="as JSON; echo always is")


def run_topic(args: argparse.Namespace) -> int:
    """List, print or measure the topics."""
    from rsenf.bus.inbox import Inbox
    from rsenf.bus.keys import LOOKING, ROOT, health_key
    from rsenf.bus.zenoh_bus import open_bus
    from rsenf.run.roster import LIVE_ONLY, Rates

    settings, site, _ = bus_of(args)
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
                print(_message_line(received, None if args.arrays else LONGEST), flush=True)
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
        print(aligned([TOPIC_HEAD, *(rate.line() for rate in found)]))
    counters = inbox.counters
    if counters.dropped or counters.rejected:
        note(f"{counters.dropped} dropped here, {counters.rejected} none of rsenf's, or broken")
    return 0


def _received(inbox: Inbox, for_s: float) -> Iterator[Received]:
    deadline = time.monotonic() + for_s
    while (remaining_s := deadline - time.monotonic()) > 0:
        received = inbox.receive(min(remaining_s, TOPIC_POLL_S))
        if received is not None:
            yield received


def _message_line(received: Received, longest: int | None) -> str:
    from rsenf.messages.codec import plain

    shown = {"topic": received.key, "message": type(received.message).__name__}
    return json.dumps(shown | plain(received.message, longest), allow_nan=False, ensure_ascii=False)


DASHBOARD = """\
Show all feeds of a bus on a web page, until Ctrl-C.

    rsenf dashboard --connect tcp/127.0.0.1:7447
    rsenf dashboard configs/live.yaml

It observes an existing bus and changes nothing. 'rsenf run' prints the address of its bus. A graph
file has it too, if the bus listens at a fixed address or is an existing one; it also shows which
nodes serve which feed. A graph with a 'dashboard' node shows the page by itself."""


POLL_S = 0.1


def add_dashboard(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    add_bus_arguments(parser, "graph")
    parser.add_argument("--host", default="127.0.0.1", metavar="ADDRESS",
                        help="to listen at (127.0.0.1: this host alone)")  # fmt: skip
    parser.add_argument("--port", type=int, default=8780, metavar="N", help="(8780; 0: any free)")
    parser.add_argument("--archive", metavar="DIR", help="with the recordings of alarms")
    parser.add_argument("--password-env", metavar="NAME", help="variable with the page's password")


def run_dashboard(args: argparse.Namespace) -> int:
    """Serve the dashboard of a bus."""
    from rsenf.bus.inbox import Inbox
    from rsenf.bus.keys import LOOKING, ROOT, health_key
    from rsenf.bus.zenoh_bus import open_bus
    from rsenf.config.node_kind import NODE_KINDS
    from rsenf.dashboard.server import DashboardServer, open_to_all
    from rsenf.dashboard.site import Site, Wiring, key_expressions, wiring_of
    from rsenf.run.process import interruptible

    if not 0 <= args.port <= 65535:
        raise UsageError(f"port {args.port}: from 0 to 65535")
    password = os.environ.get(args.password_env, "") if args.password_env else ""
    if args.password_env and not password:
        raise UsageError(f"{args.password_env} is not set", "export it")
    settings, site, graph = bus_of(args)
    archive = Path(args.archive) if args.archive else None
    wiring = wiring_of(graph, args.archive) if graph else Wiring(archive=archive)
    topics = NODE_KINDS["dashboard"].model_fields["topics"].default
    key_exprs = [f"{ROOT}/{site}/{below}" for below in topics]
    inbox = Inbox()
    with (
        interruptible() as stop,
        open_bus(settings) as bus,
        Site(wiring, time.time_ns) as shown,
        DashboardServer(shown, args.host, args.port, password) as server,
    ):
        for key_expr in (*key_exprs, *key_expressions(wiring), health_key(site, "*")):
            bus.subscribe(inbox, key_expr, LOOKING)
        if not password and (warning := open_to_all(args.host)):
            note(warning)
        say(f"{server.url}   Ctrl-C ends it")
        while not stop.is_set():
            received = inbox.receive(POLL_S)
            if received is not None:
                shown.update(received.key, received.message)
    return EXIT_DONE
