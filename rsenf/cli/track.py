"""Verbs that print a recording's ENF, and whether a feed was live."""

from __future__ import annotations

import argparse
from typing import Any

TRACK = """\
Print the ENF of a recording, one value a second.

Prints a table; with --json, JSON Lines, one object per second. t_s is counted from the first frame
to the centre of the interval that a value covers: one second (0.5, 1.5, …) by projection, a window
of 20 s (10, 11, …) by stft and similar methods. A second without a usable signal has a line too,
with enf_hz null."""


def add_track(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.description = TRACK
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    parser.add_argument("--json", action="store_true", help="JSON Lines")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say how a recording is tracked."""
    from rsenf.cli.console import (
        add_begin_argument,
        add_rate_argument,
        add_row_arguments,
        add_track_arguments,
    )

    add_begin_argument(parser, "frames", "rows", "track")
    add_rate_argument(parser)
    add_row_arguments(parser)
    add_track_arguments(parser, also={"method": "method"})


def run_track(args: argparse.Namespace) -> int:
    """Track a recording."""
    from rsenf.api.track import track
    from rsenf.cli.console import note, open_recording, print_json, progress_bar, say, say_loss

    options = options_of(args)
    recording = open_recording(args, args.input)
    with progress_bar("tracking", recording.duration_s) as progress:
        found = track(recording, **options, progress=progress)
    if args.json:
        for estimate in found.to_dict()["estimates"]:
            print_json(estimate, indent=None)
    elif found.t_s.size:
        print(found)
    for line in found.warnings:
        note(line)
    if found.usable.any():
        note(found.summary)
    else:
        say(f"{args.input}: {found.summary}")
    return say_loss(args.input, found)


def options_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of :func:`rsenf.api.track.track` for the tracking."""
    from rsenf.cli.console import row_settings, track_settings

    return {"rows": row_settings(args), "settings": track_settings(args)}


LIVE = """\
Was this feed live? Compare its flicker with the grid's frequency, second by second.

For each stretch of time: live, stale (looped, replayed or delayed; with the original time if it is
found), frozen, no_signal or undecided; and the alarms. The result equals that of the node 'live' on
the running feed: each verdict uses only data from before it."""


def add_live(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import (
        add_begin_argument,
        add_rate_argument,
        add_reference_arguments,
        add_row_arguments,
        add_track_arguments,
    )
    from rsenf.cli.options import add_settings
    from rsenf.live import LiveSettings

    parser.description = LIVE
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
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
    parser.add_argument("--store", metavar="DIR", help="where store:GRID is looked for")
    add_reference_arguments(parser)
    add_begin_argument(parser, "frames", "rows")
    add_rate_argument(parser)
    add_row_arguments(parser)
    add_track_arguments(parser)
    add_settings(parser, "live", LiveSettings)


def run_live(args: argparse.Namespace) -> int:
    """Judge the liveness of a recording."""
    from rsenf.api.live import live
    from rsenf.cli.console import (
        note,
        open_recording,
        print_json,
        progress_bar,
        references_of,
        row_settings,
        say_loss,
        track_settings,
    )
    from rsenf.cli.options import settings_of
    from rsenf.live import LiveSettings

    settings = settings_of(args, LiveSettings)
    recording = open_recording(args, args.input)
    with progress_bar("judging", recording.duration_s) as progress:
        found = live(
            recording,
            references_of(args) if args.reference else None,
            reference_camera=args.reference_camera or "",
            start=args.start,
            nominal_hz=args.nominal_hz,
            rows=row_settings(args),
            track=track_settings(args),
            settings=settings,
            progress=progress,
        )
    if args.json:
        print_json(found.to_dict())
    else:
        print(found)
        for line in found.warnings:
            if line != found.loss:  # printed by say_loss
                note(line)
    return say_loss(args.input, found)
