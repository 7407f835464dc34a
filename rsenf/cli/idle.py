"""Estimate the idle period and read-out time of the camera from the flicker of mains light.

The verdict is 'estimated', or why there is no value: 'ambiguous' (more than one fits), 'no_signal'
(no flicker of mains light), 'refused' (the recording doesn't allow a reliable answer).

With two recordings: do they have the same read-out time? If the difference exceeds the errors, they
come from different cameras, or modes of one camera; equal read-out times prove nothing.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.api.idle import IdleResult


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    parser.add_argument("input", metavar="IN", help="video, .mcap recording or .npz luminance")
    parser.add_argument("other", nargs="?", metavar="OTHER", help="another, to compare it with")
    parser.add_argument("--json", action="store_true", help="the estimate as JSON")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say how the idle period is estimated."""
    from rsenf.cli import options
    from rsenf.cli.console import add_begin_argument, add_rate_argument, add_row_arguments
    from rsenf.idle import IdleSettings

    add_begin_argument(parser, "frames", "rows")
    add_rate_argument(parser)
    add_row_arguments(parser)
    options.add_settings(parser, "idle", IdleSettings, also={"method": "method"})


def run(args: argparse.Namespace) -> int:
    """Estimate a recording's idle period, or compare two recordings."""
    from rsenf.api.idle import compare_idle
    from rsenf.cli.console import note, print_json, say_loss

    paths = [path for path in (args.input, args.other) if path is not None]
    found = [estimated(args, path) for path in paths]
    compared = compare_idle(*found) if len(found) == 2 else None
    if args.json:
        doc = compared.to_dict() | {"recordings": paths} if compared else found[0].to_dict()
        print_json(doc)
    else:
        for path, one in zip(paths, found, strict=True):
            print(f"{path}: " * (len(paths) > 1) + str(one))
            for line in one.warnings:
                if line != one.loss:  # printed by say_loss
                    note(line)
        if compared:
            print(compared)
    return max(say_loss(path, one) for path, one in zip(paths, found, strict=True))


def estimated(args: argparse.Namespace, path: str) -> IdleResult:
    """Estimate the idle period of a recording, with a progress bar."""
    from rsenf.api.idle import idle
    from rsenf.cli.console import open_recording, progress_bar

    options = options_of(args)
    recording = open_recording(args, path)
    with progress_bar("estimating", recording.duration_s) as progress:
        return idle(recording, **options, progress=progress)


def options_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of :func:`rsenf.api.idle.idle` for the estimation."""
    from rsenf.api.idle import idle_settings
    from rsenf.cli.console import row_settings
    from rsenf.cli.options import settings_of
    from rsenf.idle import IdleSettings

    settings = settings_of(args, IdleSettings)
    return {"rows": row_settings(args), "settings": idle_settings(settings)}
