"""Verbs that write what is on a bus to a recording, and play one to a bus."""

from __future__ import annotations

import argparse
import contextlib
import secrets
import sys
import time
from collections import Counter
from typing import TYPE_CHECKING

from rsenf.cli.console import say, tell
from rsenf.cli.options import add_settings, at_least_0, count, named, positive, settings_of
from rsenf.errors import EXIT_DONE, EXIT_LOSS, UsageError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from rsenf.run.replay.control import Control


RECORD = """\
Record a bus to an MCAP file, or an archive of them, until Ctrl-C or for a given time.

    rsenf record --connect tcp/127.0.0.1:7447 --out all.mcap
    rsenf record --connect tcp/127.0.0.1:7447 --archive recordings --keep-days 30 --keep-share 0.8

'rsenf run' prints the address of its bus; a graph with a 'record' node records by itself. An
archive has files by site, camera and day; 'rsenf archive' lists its contents. Data around an alarm
are never deleted; with --alarms-only nothing else is written. SIGUSR1 counts as an alarm."""


def add_record(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
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


def run_record(args: argparse.Namespace) -> int:
    """Record a bus."""
    from rsenf.bus.inbox import Inbox
    from rsenf.bus.keys import ROOT, health_key
    from rsenf.bus.zenoh_bus import BusSettings, open_bus
    from rsenf.config.schemas import RecordSettings
    from rsenf.run import recording
    from rsenf.run.process import interruptible

    config = settings_of(args, RecordSettings)
    if args.out and config.model_fields_set & {"rotation", "retention", "alarms"}:
        raise UsageError("rotation, retention and alarms are of an archive", "--archive DIR")
    inbox, deadline = Inbox(), time.monotonic() + (args.duration_s or float("inf"))
    with (
        open_bus(BusSettings(connect=tuple(args.connect))) as bus,
        recording.open_sink(config, {"site": args.site}, say) as sink,
        interruptible() as stop,
    ):
        alarming = recording.alarm_keys(config, args.site)
        alarms = recording.AlarmWatch(sink, alarming)
        named = [f"{ROOT}/{args.site}/{key_expr}" for key_expr in config.topics]
        health = [] if args.topics else [health_key(args.site, "*")]
        for key_expr in (*named, *alarming, *health):
            bus.subscribe(inbox, key_expr, recording.DELIVERY)
        say(f"recording to {sink.path}; Ctrl-C ends it")

        def ended() -> bool:
            alarms.check()
            return stop.is_set() or time.monotonic() > deadline

        with alarms.on_signal():
            guard = recording.disk_guard(config, say)
            recording.record_until(sink, inbox, ended, guard, alarms.note)
    c, out = inbox.counters, str(sink.path)
    counts = {"messages": c.received, "missed": c.missed, "dropped": c.dropped,
              "rejected": c.rejected}  # fmt: skip
    text = ", ".join(f"{number} {what}" for what, number in counts.items())
    tell(args, {"out": out, **counts}, f"{out}: {text}")
    return 0


REPLAY = """\
Replay a recording to a bus: any of its topics, at any speed, from any moment.

It starts when a subscriber appears. On a terminal, keys pause, step and seek. Results don't depend
on the speed: rate 0 plays as fast as subscribers take messages, without loss. 'rsenf run GRAPH
--replay NODE=FILE' replaces a node of a graph by its recorded output."""


POLL_S = 0.05


def add_replay(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("recording", metavar="FILE.mcap")
    parser.add_argument("--connect", action="append", default=[], metavar="ENDPOINT",
                        help="of the bus; without, a bus is opened on this host")  # fmt: skip
    parser.add_argument("--listen", metavar="ENDPOINT", help="where that bus is (a free port)")
    parser.add_argument("--topics", action="append", default=[], metavar="KEYEXPR",
                        help="below the site, such as cam1/rows, '*/track', reference/ce; "
                        "cam1/frames decodes the video again (all but frames)")  # fmt: skip
    parser.add_argument("--rename", action="append", default=[], type=named, metavar="OLD=NEW",
                        help="a camera, or one topic: door=cam1, door/rows=cam1/rows")  # fmt: skip
    parser.add_argument("--site", default="", help="to play to (as recorded)")
    parser.add_argument("--rate", type=at_least_0, default=1.0, metavar="X",
                        help="of its own speed (1); 0: as fast as it is taken")  # fmt: skip
    parser.add_argument("--start-s", type=at_least_0, default=0.0, metavar="S", help="from (0)")
    parser.add_argument("--end-s", type=positive, metavar="S", help="to (the end)")
    parser.add_argument("--loop", type=count, nargs="?", const=0, default=1, metavar="N",
                        help="play it N times; without N until stopped")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="what was played, as JSON")


def run_replay(args: argparse.Namespace) -> int:
    """Play a recording."""
    from rsenf.bus.frames import FrameSender
    from rsenf.bus.keys import delivery_of, topic_of
    from rsenf.bus.zenoh_bus import BusSettings, free_endpoint, open_bus
    from rsenf.run.process import interruptible
    from rsenf.run.replay.control import Control
    from rsenf.run.replay.player import Player, Playing
    from rsenf.run.replay.tape import FRAMES

    connect = tuple(args.connect)
    listen = () if connect else (args.listen or free_endpoint(),)
    playing = Playing(
        topics=tuple(args.topics), rename=dict(args.rename), site=args.site, rate=args.rate,
        start_s=args.start_s, end_s=args.end_s, loop=args.loop,
    )  # fmt: skip
    sent: Counter[str] = Counter()
    with interruptible() as stop:
        control = Control(stop)
        player = Player(
            args.recording, playing, run_id=secrets.token_hex(4), clock_ns=time.time_ns,
            control=control,
        )  # fmt: skip
        mode = "client" if connect else "router"
        with open_bus(BusSettings(mode=mode, connect=connect, listen=listen)) as bus:
            publishers = {
                key: bus.publisher(key, delivery_of(topic_of(key))) for key in player.keys
            }
            # A subscriber may be on another host: frames are sent with their pixels.
            send = {
                key: FrameSender(p, "", 0, stop.is_set).send if topic_of(key) == FRAMES else p.send
                for key, p in publishers.items()
            }
            say(f"waiting for a listener at {', '.join(connect or listen)}; Ctrl-C ends it")
            while not (stop.is_set() or any(p.is_heard for p in publishers.values())):
                stop.wait(POLL_S)
            with _keys(control):
                for key, message in player:
                    is_end = message.header.is_end
                    (publishers[key].send if is_end else send[key])(message)
                    sent[key] += not is_end
    document = {"recording": args.recording, "messages": sent, "passes": player.passes,
                "loss": player.loss}  # fmt: skip
    tell(args, document, f"{args.recording}: {sent.total()} messages on {len(sent)} topics")
    if player.loss:
        say(player.loss)
    return EXIT_LOSS if player.loss else EXIT_DONE


def _keys(control: Control) -> AbstractContextManager[None]:
    """Enable keyboard control if stdin is a terminal."""
    if not sys.stdin.isatty():
        return contextlib.nullcontext()
    from rsenf.run.replay.control import HELP, keyboard

    say(HELP)
    return keyboard(sys.stdin.fileno(), control)
