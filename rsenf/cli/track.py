"""Print the ENF of a recording, one value a second.

Without --json a table goes to stdout; with it JSON Lines, one object for each second, t_s counted
from the first frame to the centre of what the value covers: a second (0.5, 1.5, …) by
projection, a window of 20 s (10, 11, …) by stft and its kin. A second without a usable signal is a
line too: its enf_hz is null.
"""

from __future__ import annotations

import argparse
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    parser.add_argument("--json", action="store_true", help="JSON Lines")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Arguments that say how a recording is tracked."""
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


def run(args: argparse.Namespace) -> int:
    """Track a recording."""
    from rsenf.api.track import track
    from rsenf.cli.console import (
        note,
        open_recording,
        print_json,
        progress_bar,
        say,
        say_loss,
    )

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
    """Return how a recording is to be tracked, as the function takes it."""
    from rsenf.cli.console import row_settings, track_settings

    return {"rows": row_settings(args), "settings": track_settings(args)}
