"""Was this feed live? Compare its flicker with the grid's frequency, second by second.

For each stretch of time: live, stale (looped, replayed or delayed; with the original time if it is
found), frozen, no_signal or undecided; and the alarms. The result equals that of the node 'live' on
the running feed: each verdict uses only data from before it.
"""

from __future__ import annotations

import argparse


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
