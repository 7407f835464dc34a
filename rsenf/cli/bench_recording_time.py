"""``rsenf bench recording-time``: films, trials, table."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.bench.recording_time.plan import RecordingPlan

FILMS = "films"
_QUICK: dict[str, Any] = {
    "size": "240p",
    "codings": ("lossless", "50k"),
    "clips": 2,
    "duration_s": 130.0,
    "reference_s": 4 * 3600.0,
}
_GIVEN = ("codings", "first_seed", "clips", "duration_s")
_FIXED = {"frame_rates": "--frame-rates", "nominals_hz": "--nominal-hz"}


def run(args: argparse.Namespace) -> int:
    """Make what is missing, and print the table.

    Raises
    ------
    UsageError
        For a plan that can't be meant so.
    """
    from rsenf.errors import EXIT_DONE, UsageError

    plan = plan_of(args)
    if args.film_only and not args.out:
        raise UsageError("--film-only without --out", "name the folder of the films")
    _film(args, plan, args.out)
    return EXIT_DONE


def plan_of(args: argparse.Namespace) -> RecordingPlan:
    """Return the plan that the arguments mean.

    Raises
    ------
    UsageError
        For what this table doesn't leave open, or what can't be meant so.
    """
    from rsenf.bench.recording_time.plan import FRAME_RATE, NOMINAL_HZ, RecordingPlan
    from rsenf.errors import UsageError

    for name, option in _FIXED.items():
        if getattr(args, name) is not None:
            hint = f"its films have {FRAME_RATE} fps and {NOMINAL_HZ:g} Hz"
            raise UsageError(f"{args.table} takes no {option}", hint)
    if args.sizes and len(args.sizes) > 1:
        raise UsageError(f"{args.table} films in one size", "name one in --sizes")
    given = {name: getattr(args, name) for name in _GIVEN if getattr(args, name) is not None}
    if args.sizes:
        given["size"] = args.sizes[0]
    return RecordingPlan(**((_QUICK if args.quick else {}) | given))


def _film(args: argparse.Namespace, plan: RecordingPlan, folder: Path) -> None:
    from rsenf.bench.recording_time.session import make_missing
    from rsenf.cli.bench import grids_of
    from rsenf.cli.console import progress_bar, say

    films = plan.films()
    with progress_bar("filming", sum(film.duration_s for film in films)) as bar:

        def progress(done: int, missing: int) -> None:
            if not done:
                say(f"films to make: {missing} of {len(films)}")
            bar((len(films) - missing + done) * plan.duration_s)

        make_missing(films, folder / FILMS, grids_of(args), max(args.jobs, 1), progress)
