"""Write what is on a bus to an MCAP file, or an archive of them, until Ctrl-C or for a given time.

    rsenf record --connect tcp/127.0.0.1:7447 --out all.mcap
    rsenf record --connect tcp/127.0.0.1:7447 --archive recordings --keep-days 30 --keep-share 0.8

'rsenf run' says where its bus is; a graph with a 'record' node records by itself. An archive has
files by site, camera and day; 'rsenf archive' tells what is in it. What lies about an alarm is
never deleted; with --alarms-only nothing else is written, and SIGUSR1 is an alarm, too.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.config.recording import RecordSettings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import positive

    parser.add_argument("--connect", action="append", required=True, metavar="ENDPOINT",
                        help="of the bus, for example tcp/127.0.0.1:7447")  # fmt: skip
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--out", metavar="FILE.mcap")
    where.add_argument("--archive", metavar="DIR")
    parser.add_argument("--site", default="*", help="of the graph (any)")
    parser.add_argument("--topics", action="append", metavar="KEYEXPR",
                        help="below the site, for example cam1/track (all)")  # fmt: skip
    parser.add_argument("--duration-s", type=positive, metavar="S", help="stop after this long")
    parser.add_argument("--overwrite", action="store_true")
    parser.add_argument("--warn-free-mb", type=positive, metavar="MB",
                        help="warn below so much free (2000, at most 10 %%)")  # fmt: skip
    parser.add_argument("--stop-free-mb", type=positive, metavar="MB",
                        help="stop below so much (100, at most 1 %% of the disk)")  # fmt: skip
    parser.add_argument("--json", action="store_true")
    archive = parser.add_argument_group("archive")
    archive.add_argument("--rotate-s", type=positive, metavar="S", help="longest file (3600)")
    archive.add_argument("--rotate-mb", type=positive, metavar="MB", help="largest file (1000)")
    archive.add_argument("--keep-days", type=positive, metavar="D", help="delete what is older")
    archive.add_argument("--keep-share", type=positive, metavar="SHARE",
                         help="of the disk, for the archive; the oldest go")  # fmt: skip
    archive.add_argument("--alarm", metavar="KEYEXPR",
                         help="messages that are alarms, below the site (*/alarm)")  # fmt: skip
    archive.add_argument("--before-s", type=positive, metavar="S", help="of an alarm (120)")
    archive.add_argument("--after-s", type=positive, metavar="S", help="of an alarm (60)")
    archive.add_argument("--alarms-only", action="store_true", default=None,
                         help="keep the last minutes in memory until an alarm comes")  # fmt: skip
    archive.add_argument("--memory-mb", type=positive, metavar="MB",
                         help="most to keep in memory of a camera (256)")  # fmt: skip


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

    config = _config(args)
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


def _config(args: argparse.Namespace) -> RecordSettings:
    """Return what a node of a graph would be told."""
    from rsenf.config.recording import RecordSettings
    from rsenf.errors import UsageError
    from rsenf.record.settings import AlarmSettings, DiskLimits, Retention, Rotation

    archive = {
        "rotation": _given(every_s=args.rotate_s, size_mb=args.rotate_mb),
        "retention": _given(days=args.keep_days, disk_share=args.keep_share),
        "alarms": _given(trigger=args.alarm, before_s=args.before_s, after_s=args.after_s,
                         only=args.alarms_only, memory_mb=args.memory_mb),
    }  # fmt: skip
    if args.out and any(archive.values()):
        raise UsageError("rotation, retention and alarms are of an archive", "--archive DIR")
    disk = _given(warn_mb=args.warn_free_mb, stop_mb=args.stop_free_mb)
    return RecordSettings(
        out=args.out,
        archive=args.archive,
        topics=tuple(args.topics or ["**"]),
        overwrite=args.overwrite,
        rotation=Rotation(**archive["rotation"]),
        retention=Retention(**archive["retention"]),
        alarms=AlarmSettings(**archive["alarms"]),
        disk=DiskLimits(**disk),
    )


def _given(**settings: object) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if value is not None}
