"""``rsenf bench recording-time``: films, trials, table."""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.batch.journal import Record
    from rsenf.bench.recording_time.plan import RecordingPlan

_FILMS, _TRIALS = "films", "recording-time.jsonl"
_QUICK: dict[str, Any] = {
    "size": "240p",
    "codings": ("lossless", "50k"),
    "clips": 1,
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
    from rsenf.bench.recording_time.document import tabulate
    from rsenf.bench.recording_time.text import page, text
    from rsenf.cli.console import print_json, say
    from rsenf.errors import EXIT_DONE, EXIT_FAILED, UsageError

    plan = plan_of(args)
    if args.only and not args.out:
        raise UsageError("--only without --out", "name the folder of the films")
    if args.only == "films":
        _film(args, plan, args.out)
        return EXIT_DONE
    if args.out:
        records = _records(args, plan, args.out)
    else:
        with tempfile.TemporaryDirectory() as folder:
            records = _records(args, plan, Path(folder))
    document = tabulate(records)
    if args.json:
        print_json(document)
    else:
        print(page(document) if args.markdown else text(document))
    broke = sum(row["broke"] for row in document["rows"])
    if broke:
        say(f"methods broke {broke} times: see 'broke' in the results")
    return EXIT_FAILED if broke else EXIT_DONE


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

        make_missing(films, folder / _FILMS, grids_of(args), max(args.jobs, 1), progress)


def _records(args: argparse.Namespace, plan: RecordingPlan, folder: Path) -> list[Record]:
    from rsenf.batch.journal import read_records
    from rsenf.bench.recording_time.films import has_film
    from rsenf.bench.recording_time.references import NOISE_HZ
    from rsenf.bench.recording_time.session import cuts_of
    from rsenf.bench.recording_time.trials import run_trials
    from rsenf.bench.session import measure_missing
    from rsenf.cli.bench import grids_of
    from rsenf.cli.console import progress_bar, say

    out = folder / _TRIALS
    if args.table_only:
        return list(read_records(out).values())
    if args.only != "trials":
        _film(args, plan, folder)
    made = [film for film in plan.films() if has_film(folder / _FILMS, film)]
    cuts = cuts_of(made, NOISE_HZ)
    with progress_bar("trying", sum(c.film.duration_s for c in cuts)) as bar:

        def progress(done: int, missing: int) -> None:
            if not done:
                say(f"cuts to try: {missing} of {len(cuts)}, of {len(made)} films")
            bar((len(cuts) - missing + done) * plan.duration_s)

        work = partial(run_trials, films=folder / _FILMS, grids=grids_of(args))
        return measure_missing(cuts, work, out, max(args.jobs, 1), progress)
