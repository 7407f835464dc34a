"""Print the ENF of a recording, one value a second.

Prints a table; with --json, JSON Lines, one object per second. t_s is counted from the first frame
to the centre of the interval that a value covers: one second (0.5, 1.5, …) by projection, a window
of 20 s (10, 11, …) by stft and similar methods. A second without a usable signal has a line too,
with enf_hz null.
"""

from __future__ import annotations

import argparse
from typing import Any


def add_track(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
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
