"""List the nodes on a bus, and their states.

    rsenf nodes --connect tcp/127.0.0.1:7447
    rsenf nodes GRAPH.yaml
    rsenf nodes GRAPH.yaml --wait-s 60 && rsenf topic hz --graph GRAPH.yaml

States are those that nodes report, and: 'silent', present without health messages (it hangs);
'lost', gone without a last message; 'absent', in the graph but never seen. Latency is the median
and the 95th percentile of the last minute: 'arrival', since the picture arrived at the host, and
'exposure', since it was taken by the camera's clock, if the stream has that time.
"""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.run.roster import Roster, Seen

HEAD = ("node", "kind", "state", "in/s", "arrival s", "exposure s", "queue", "dropped", "missed",
        "rejected", "again", "heard s", "MB", "")  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import add_bus_arguments
    from rsenf.cli.options import positive

    add_bus_arguments(parser, "graph")
    parser.add_argument("--for-s", type=positive, default=1.5, metavar="S", help="look for (1.5)")
    parser.add_argument("--wait-s", type=positive, metavar="S",
                        help="look until all run or are done; if not by then, fail")  # fmt: skip
    parser.add_argument("--json", action="store_true")


def run(args: argparse.Namespace) -> int:
    """List the nodes."""
    import time

    from rsenf.cli.console import aligned, note, print_json

    roster = _waited_for(args) if args.wait_s else _look(args)
    if args.json:
        print_json(roster.as_json())
        return 0
    now_s, now_ns = time.monotonic(), time.time_ns()
    nodes = roster.nodes()
    if not nodes:
        note("no node on this bus")
        return 0
    print(aligned([HEAD, *(_line(seen, now_s, now_ns) for seen in nodes)]))
    return 0


def _look(args: argparse.Namespace) -> Roster:
    """Listen for a while; return what was seen."""
    import time

    from rsenf.bus.zenoh_bus import open_bus
    from rsenf.cli.console import bus_of
    from rsenf.run.roster import Roster

    settings, graph = bus_of(args)
    with open_bus(settings) as bus:
        roster = Roster(bus, graph.site if graph else args.site)
        if graph:
            roster.expect(graph.site, graph.nodes)
        deadline = time.monotonic() + args.for_s
        while (remaining_s := deadline - time.monotonic()) > 0:
            roster.listen(remaining_s)
    return roster


def _waited_for(args: argparse.Namespace) -> Roster:
    """Wait until every node is up. The time limit is extended on a slow machine."""
    import time

    from rsenf.errors import RsenfError, UsageError
    from rsenf.run.patience import PAUSE_S, Patience

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
