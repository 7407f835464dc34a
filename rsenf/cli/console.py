"""What the verbs share: words on stderr, progress on a terminal, JSON, arguments in common."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.rows.settings import RowsSettings
    from rsenf.track import TrackSettings

# The ENF methods that have no use for a choice among harmonics and lines.
ALL_LINES = ("projection", "paper")
# Fills the idle period with rows.
INTERPOLATING = "paper"
# Takes means of regions, finer than rows and strips.
REGIONS = "superpixel"


@contextmanager
def progress_bar(
    what: str, total: float | None, unit: str = "s of video"
) -> Iterator[Callable[[float], None]]:
    """Show a bar on stderr, only on a terminal; yields a callable that takes how much is done."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn(f"{{task.completed:.0f}} {unit}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def stages() -> Iterator[Callable[[str], None]]:
    """Say what is being done; yields a callable that is told in words.

    On a terminal they stand beside a spinner and the time, elsewhere each is a line.
    """
    if not sys.stderr.isatty():
        yield note
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task("", total=None)
        yield lambda doing: shown.update(task, description=doing)


def say(text: str) -> None:
    """Tell a person what went wrong or is under way, on stderr."""
    print(f"rsenf: {text}", file=sys.stderr, flush=True)


def note(text: str) -> None:
    """Tell a person what else to know, on stderr."""
    print(f"note: {text}", file=sys.stderr)


def print_json(value: Any, *, indent: int | None = 2) -> None:
    """Print JSON; a NaN that slipped through is an error here, not a broken reader there."""
    print(json.dumps(value, indent=indent, allow_nan=False))


def aligned(lines: Sequence[Sequence[str]]) -> str:
    """Return lines of cells with their columns aligned; a line may have fewer than the first."""
    rows = [[*line, *[""] * (len(lines[0]) - len(line))] for line in lines]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    padded = ["  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in rows]
    return "\n".join(line.rstrip() for line in padded)


def add_begin_argument(parser: argparse.ArgumentParser, *topics: str) -> None:
    """Argument of every verb that may begin with another of a recording's topics than the rows."""
    parser.add_argument(
        "--from", dest="begin", choices=topics, default="rows",
        help="what to take of an MCAP recording; frames: its video, decoded again (rows)",
    )  # fmt: skip


def add_row_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of every verb that samples rows."""
    group = parser.add_argument_group("rows")
    group.add_argument(
        "--nominal-hz", type=float, choices=(50.0, 60.0), help="grid; found from the data otherwise"
    )
    group.add_argument(
        "--read-out", choices=("auto", "rows", "columns"), default="auto",
        help="columns: turned camera; auto: found from the data (auto)",
    )  # fmt: skip
    group.add_argument("--no-mask", action="store_true", help="keep pixels that move")
    group.add_argument(
        "--camera", default="", metavar="NAME", help="of an MCAP recording with several"
    )


def row_settings(args: argparse.Namespace) -> RowsSettings:
    """Return the rows settings that the arguments ask for."""
    from rsenf.rows.settings import RowsSettings

    regions = getattr(args, "enf_method", None) == REGIONS
    return RowsSettings(read_out_axis=args.read_out, mask=not args.no_mask, tile_means=regions)


def add_track_arguments(parser: argparse.ArgumentParser, *method: str) -> None:
    """Arguments of every verb that tracks ENF; ``method`` spells the one that names how."""
    group = parser.add_argument_group("ENF")
    group.add_argument(
        *method, dest="enf_method", metavar="NAME", help="ENF estimator, such as projection or stft"
    )
    group.add_argument(
        "--harmonic", type=int, choices=(1, 2, 3), help="of the illumination frequency (1)"
    )
    group.add_argument(
        "--line", type=int, metavar="M", help="line k·f0 + M·F_r; the strongest otherwise"
    )
    group.add_argument(
        "--interpolation", metavar="NAME",
        help="how the method paper fills the idle period (neighbour_mean)",
    )  # fmt: skip


def track_settings(args: argparse.Namespace, nominal_hz: float | None) -> TrackSettings:
    """Return the track settings that the arguments ask for."""
    from rsenf.errors import UsageError
    from rsenf.track import METHODS, TrackSettings

    needed = _needed_by_matcher(args)
    method = args.enf_method or needed or TrackSettings.method
    if method not in METHODS:
        raise UsageError(f"no ENF method {method!r}", f"one of {', '.join(METHODS)}")
    if needed and method != needed:
        raise UsageError(
            f"{args.method} compares the hypotheses of the ENF method {needed}, not {method}",
            "leave --enf-method out",
        )
    if method in ALL_LINES and (args.harmonic or args.line is not None):
        raise UsageError(
            f"{method} follows all harmonics and lines together",
            "leave --harmonic and --line out, or name another method, such as stft",
        )
    if args.interpolation and method != INTERPOLATING:
        raise UsageError(
            f"{method} interpolates nothing",
            f"leave --interpolation out, or take the method {INTERPOLATING}",
        )
    return TrackSettings(
        method=method,
        nominal_hz=args.nominal_hz or nominal_hz,
        harmonic=args.harmonic or 1,
        line_m=args.line,
        interpolation=args.interpolation or TrackSettings.interpolation,
    )


def _needed_by_matcher(args: argparse.Namespace) -> str:
    """ENF method that the matcher named needs; empty when none is named, or any will do."""
    if not hasattr(args, "method"):
        return ""
    from rsenf.match.stage import tracker_for

    return tracker_for(args.method)


def add_reference_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of every verb that reads a grid reference."""
    from rsenf.cli.options import positive

    group = parser.add_argument_group("reference")
    group.add_argument(
        "--timezone", metavar="ZONE", help="of its times, e.g. Europe/Paris; UTC otherwise"
    )
    group.add_argument(
        "--step-s", type=positive, metavar="S", help="between its values, when it has no times"
    )
    group.add_argument(
        "--column", metavar="NAME", help="that holds the frequency, when not found by its name"
    )
    group.add_argument(
        "--stamp",
        choices=("start", "centre"),
        default="start",
        help="whether a value's time is the start or the centre of what it covers",
    )
