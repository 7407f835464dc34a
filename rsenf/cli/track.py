"""Verbs that print a recording's or a camera's ENF, and whether a feed was live."""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.cli import console, options
from rsenf.cli.options import given_by, settings_of
from rsenf.errors import UsageError

if TYPE_CHECKING:
    from rsenf.messages import EnfEstimate

TRACK = """\
Print the ENF of a recording, one value a second.

Prints a table; with --json, JSON Lines, one object per second. t_s is counted from the first frame
to the centre of the interval that a value covers: one second (0.5, 1.5, …) by projection, a window
of 20 s (10, 11, …) by stft and similar methods. A second without a usable signal has a line too,
with enf_hz null. Each value is printed as it comes, the first ones after some 16 to 30 s of video.

A camera (rtsp://…, http://…, /dev/video0) is tracked until Ctrl-C, and connected again when it is
lost."""


def add_track(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap, .npz, or a camera's address")
    parser.add_argument("--json", action="store_true", help="JSON Lines")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say how a recording is tracked."""
    console.add_recording_arguments(parser, "frames", "rows", "track")
    console.add_track_arguments(parser, also={"method": "method"})


def run_track(args: argparse.Namespace) -> int:
    """Track a recording, or a camera until it is interrupted."""
    from rsenf.api.track import HEADING, estimate_json, estimate_words, track
    from rsenf.run.live_input import LiveInput, is_live
    from rsenf.run.process import interruptible

    begun = False

    def show(estimate: EnfEstimate) -> None:
        nonlocal begun
        if args.json:
            console.print_json(estimate_json(estimate), indent=None)
        else:
            print(*([] if begun else [HEADING]), estimate_words(estimate), sep="\n", flush=True)
        begun = True

    options: dict[str, Any] = {**options_of(args), "on_estimate": show}
    if is_live(args.input):
        console.refuse_choice(args)
        with interruptible() as stop:  # the first Ctrl-C ends it as if it were over
            rate_hz, effort = args.frame_rate_hz, args.effort
            camera = LiveInput(args.input, stop, console.note, frame_rate_hz=rate_hz, effort=effort)
            found = track(camera, **options)
    else:
        recording, label = console.open_recording(args, args.input), "tracking"
        with console.progress_bar(label, recording.duration_s, printing=True) as progress:
            found = track(recording, **options, progress=progress)
    for line in found.warnings:
        console.note(line)
    if found.usable.any():
        console.note(found.summary)
    else:
        console.say(f"{found.recording}: {found.summary}")
    return console.say_loss(found.recording, found)


def options_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of :func:`rsenf.api.track.track` for the tracking."""
    return {"rows": console.row_settings(args), "settings": console.track_settings(args)}


LIVE = """\
Was this feed live? Compare its flicker with the grid's frequency, second by second.

For each stretch of time: live, stale (looped, replayed or delayed; with the original time if it is
found), frozen, no_signal or undecided; and the alarms. The result equals that of the node 'live' on
the running feed: each verdict uses only data from before it.

A camera (rtsp://…, http://…) is judged until Ctrl-C, each change printed as it comes. Its reference
is one of now: a table or WAV that grows, sound:, or the address of a camera that can be trusted."""


def add_live(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.live import LiveSettings

    parser.add_argument("input", metavar="IN", help="video, .mcap, .npz, or a camera's address")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--reference", nargs=1, metavar="REF",
        help="CSV, Parquet, WAV of the mains, or store:GRID, with times of day",
    )  # fmt: skip
    what.add_argument("--reference-camera", metavar="CAM", help="another camera of the recording")
    parser.add_argument(
        "--start", metavar="TIME",
        help="when the first picture was taken; without, when pictures arrived, if recorded",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="all verdicts and alarms as JSON")
    console.add_reference_arguments(parser)
    console.add_recording_arguments(parser, "frames", "rows")
    console.add_track_arguments(parser)
    options.add_settings(parser, "live", LiveSettings)


def run_live(args: argparse.Namespace) -> int:
    """Judge the liveness of a recording, or of a camera until it is interrupted."""
    from rsenf.run.live_input import is_live

    return _watch(args) if is_live(args.input) else _judge(args)


def _judge(args: argparse.Namespace) -> int:
    from rsenf.api.live import live
    from rsenf.live import LiveSettings

    settings = settings_of(args, LiveSettings)
    recording = console.open_recording(args, args.input)
    with console.progress_bar("judging", recording.duration_s) as progress:
        found = live(
            recording, console.references_of(args) if args.reference else None,
            reference_camera=args.reference_camera or "", start=args.start,
            nominal_hz=args.nominal_hz, rows=console.row_settings(args),
            track=console.track_settings(args), settings=settings, progress=progress,
        )  # fmt: skip
    console.tell(args, found.to_dict(), found, found.remarks)
    return console.say_loss(args.input, found)


def _watch(args: argparse.Namespace) -> int:
    """Judge a camera by a graph of its own, as 'rsenf init' would write it."""
    from rsenf.api.live import live_result, stands_for, verdict_line
    from rsenf.config import load_graph
    from rsenf.config.site_graph import graph_text, site_nodes, without_passwords
    from rsenf.messages import Alarm, Liveness
    from rsenf.run.inline import Analysis
    from rsenf.run.process import interruptible
    from rsenf.run.restart_policy import NodeState
    from rsenf.run.supervisor import check_ended, start_graph

    console.refuse_choice(args)
    if not args.reference or args.start or args.frame_rate_hz:
        raise UsageError(
            "a camera tells its own times and has no other camera", "give it a --reference alone"
        )
    verdicts: list[Liveness] = []
    alarms: list[Alarm] = []
    last: Liveness | None = None

    def show(_source: str, message: Any) -> None:
        nonlocal last
        if isinstance(message, Alarm):
            alarms.append(message)
            line = message.line(by_host=True)
        elif isinstance(message, Liveness):
            before, last = last, message
            if before and stands_for(before) == stands_for(message):
                return
            verdicts.append(message)
            line = verdict_line(message)
        else:
            return
        if not args.json:
            print(line, flush=True)

    def tell(node: NodeState) -> None:
        if node.kind in ("decode", "reference") and node.detail and not node.went_wrong:
            console.note(f"{node.name}: {node.detail}")

    nodes, variables = without_passwords(
        site_nodes({"camera": args.input}, args.reference[0], _settings(args))
    )
    os.environ.update(variables)
    with tempfile.TemporaryDirectory(prefix="rsenf-live-") as folder:
        path = Path(folder, "graph.yaml")
        path.write_text(graph_text("live", nodes, restart=False), encoding="utf-8")
        graph = load_graph(path)
        with start_graph(graph, path, tell) as run, interruptible(run.kill) as stop:
            run.on_result = show
            run.wait(stop)
            code = check_ended(run)
    if args.json:
        verdicts += [last] if last else []
        found = live_result(args.input, Analysis(verdicts=verdicts, alarms=alarms))
        console.print_json(found.to_dict())
    elif last:
        print(verdict_line(last, "at the end "))
    return code


def _settings(args: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Return the settings of the arguments by node kind."""
    from rsenf.live import LiveSettings
    from rsenf.rows.settings import RowsSettings
    from rsenf.track import TrackSettings

    grid = {"nominal_hz": args.nominal_hz} if args.nominal_hz else {}
    reading = {
        k: v for k, v in console.read_options(args).items() if k != "assumed_hz" and v is not None
    }
    reading |= {"store": args.store} if args.store else {}
    return {
        "decode": {
            "rows": console.EITHER_WAY | given_by(args, RowsSettings),
            "effort": args.effort,
            "wait_for_source": False,
        },
        "track": {"track": grid | given_by(args, TrackSettings), "idle": grid},
        "reference": reading,
        "live": {"live": given_by(args, LiveSettings)},
    }
