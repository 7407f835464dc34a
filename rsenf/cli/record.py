"""Record a bus to an MCAP file, or an archive of them, until Ctrl-C or for a given time.

    rsenf record --connect tcp/127.0.0.1:7447 --out all.mcap
    rsenf record --connect tcp/127.0.0.1:7447 --archive recordings --keep-days 30 --keep-share 0.8

'rsenf run' prints the address of its bus; a graph with a 'record' node records by itself. An
archive has files by site, camera and day; 'rsenf archive' lists its contents. Data around an alarm
are never deleted; with --alarms-only nothing else is written. SIGUSR1 counts as an alarm.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.config.schemas import RecordSettings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.options import add_settings, positive
    from rsenf.config.schemas import RecordSettings

    parser.add_argument("--connect", action="append", required=True, metavar="ENDPOINT",
                        help="of the bus, for example tcp/127.0.0.1:7447")  # fmt: skip
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--out", metavar="FILE.mcap")
    where.add_argument("--archive", metavar="DIR")
    parser.add_argument("--site", default="*", help="of the graph (any)")
    parser.add_argument("--duration-s", type=positive, metavar="S", help="stop after this long")
    parser.add_argument("--json", action="store_true")
    add_settings(parser, "recording", RecordSettings)


def run(args: argparse.Namespace) -> int:
    """Record a bus."""
    import time

    from rsenf.bus.inbox import Inbox
    from rsenf.bus.keys import ROOT, health_key
    from rsenf.bus.zenoh_bus import BusSettings, open_bus
    from rsenf.cli.console import print_json, say
    from rsenf.run.alarms import AlarmWatch
    from rsenf.run.recording import DELIVERY, disk_guard, open_sink, record_until
    from rsenf.run.signals import interruptible

    config = _settings(args)
    inbox, deadline = Inbox(), time.monotonic() + (args.duration_s or float("inf"))
    with (
        open_bus(BusSettings(connect=tuple(args.connect))) as bus,
        open_sink(config, {"site": args.site}, say) as sink,
        interruptible(lambda: None) as stop,
    ):
        alarms = AlarmWatch(sink, f"{ROOT}/{args.site}/{config.alarms.trigger}")
        named = [f"{ROOT}/{args.site}/{key_expr}" for key_expr in config.topics]
        health = [] if args.topics else [health_key(args.site, "*")]
        for key_expr in (*named, *alarms.key_exprs, *health):
            bus.subscribe(inbox, key_expr, DELIVERY)
        say(f"recording to {sink.path}; Ctrl-C ends it")

        def ended() -> bool:
            alarms.check()
            return stop.is_set() or time.monotonic() > deadline

        with alarms.on_signal():
            record_until(sink, inbox, ended, disk_guard(config, say), alarms.note)
    c, out = inbox.counters, str(sink.path)
    if args.json:
        print_json({"out": out, "messages": c.received, "missed": c.missed,
                    "dropped": c.dropped, "rejected": c.rejected})  # fmt: skip
    else:
        print(f"{out}: {c.received} messages, {c.missed} missed, {c.dropped} dropped, "
              f"{c.rejected} rejected")  # fmt: skip
    return 0


def _settings(args: argparse.Namespace) -> RecordSettings:
    from rsenf.cli.options import settings_of
    from rsenf.config.schemas import RecordSettings
    from rsenf.errors import UsageError

    settings = settings_of(args, RecordSettings)
    if args.out and settings.model_fields_set & {"rotation", "retention", "alarms"}:
        raise UsageError("rotation, retention and alarms are of an archive", "--archive DIR")
    return settings
