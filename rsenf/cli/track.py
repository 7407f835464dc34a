"""Print the ENF of a recording, one value a second.

Prints a table; with --json, JSON Lines, one object per second. t_s is counted from the first frame
to the centre of the interval that a value covers: one second (0.5, 1.5, …) by projection, a window
of 20 s (10, 11, …) by stft and similar methods. A second without a usable signal has a line too,
with enf_hz null.

A camera (rtsp://…, http://…, /dev/video0) is tracked until Ctrl-C, each value printed as it comes,
and connected again when it is lost.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.messages import EnfEstimate


def add_track(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap, .npz, or a camera's address")
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
    """Track a recording, or a camera until it is interrupted."""
    from rsenf.api.track import HEADING, estimate_json, estimate_words, track
    from rsenf.cli.console import note, opened_input, print_json, progress_bar, say, say_loss
    from rsenf.run.live_input import LiveInput

    begun = False

    def show(estimate: EnfEstimate) -> None:
        nonlocal begun
        if args.json:
            print_json(estimate_json(estimate), indent=None)
        else:
            print(*([] if begun else [HEADING]), estimate_words(estimate), sep="\n", flush=True)
        begun = True

    options = options_of(args)
    with opened_input(args, args.input) as recording:
        if isinstance(recording, LiveInput):
            found = track(recording, **options, on_estimate=show)
        else:
            with progress_bar("tracking", recording.duration_s) as progress:
                found = track(recording, **options, progress=progress)
            for estimate in found.analysis.estimates:
                show(estimate)
    for line in found.warnings:
        note(line)
    if found.usable.any():
        note(found.summary)
    else:
        say(f"{found.recording}: {found.summary}")
    return say_loss(found.recording, found)


def options_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of :func:`rsenf.api.track.track` for the tracking."""
    from rsenf.cli.console import row_settings, track_settings

    return {"rows": row_settings(args), "settings": track_settings(args)}
