"""``rsenf bench discover``: effects hidden in recordings, and what the workflow says of each."""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.batch.journal import Record
    from rsenf.bench.discover.plan import Case, Plan

_RECORDS = "discover.jsonl"
_QUICK_EFFECTS = ("harmonics", "frame_drop", "timestamp_jitter")


def run(args: argparse.Namespace) -> int:
    """Make what is missing, and print the table."""
    from rsenf.bench.discover.picture import draw
    from rsenf.bench.discover.table import tabulated, text
    from rsenf.cli.console import note, print_json
    from rsenf.errors import EXIT_DONE

    document = tabulated(_records(args, plan_of(args)))
    if args.picture:
        draw(args.picture, document)
        note(f"picture: {args.picture}")
    if args.json:
        print_json(document)
    else:
        print(text(document, on_page=args.markdown))
    return EXIT_DONE


def plan_of(args: argparse.Namespace) -> Plan:
    """Return the plan that the arguments mean.

    Raises
    ------
    UsageError
        For effects that it can't hide.
    """
    from rsenf.bench.discover.beside import SKEW
    from rsenf.bench.discover.plan import Plan, left_out, listed
    from rsenf.cli.console import note
    from rsenf.errors import UsageError

    first, each = args.first_seed or 0, args.clips
    if args.quick:
        return Plan(
            first_seed=first, each=each or 1, none=1, outside=1, pairs=0, duration_s=27.0,
            effects=_QUICK_EFFECTS,
        )  # fmt: skip
    can = (*listed(), SKEW)
    unknown = set(args.hide or ()) - set(can)
    if unknown:
        why = left_out().get(min(unknown), "it is no effect")
        raise UsageError(f"--hide {min(unknown)}: {why}", f"one of {', '.join(can)}")
    effects = tuple(name for name in args.hide or listed() if name != SKEW)
    if not args.hide:
        for name, why in left_out().items():
            note(f"not hidden among the others: {name}: {why}")
    each = 20 if each is None else each
    others = {"none": 5 * each, "outside": 2 * each, "pairs": 2 * each}
    if args.hide or args.video:
        others = dict.fromkeys(others, 0)
    return Plan(
        first_seed=first,
        each=each,
        times=args.times or 3.0,
        duration_s=args.duration_s or (30.0 if args.video else 60.0),
        video=args.video,
        effects=effects,
        **others,
    )


def clock_cases_of(args: argparse.Namespace, plan: Plan) -> list[Case]:
    """Return the cases that come with a reference, of seeds after those of the plan."""
    from rsenf.bench.discover.beside import SKEW, clock_cases

    if args.quick or args.video or (args.hide and SKEW not in args.hide):
        return []
    return clock_cases(plan.each, plan.first_seed + len(plan.cases()), plan.duration_s)


def _records(args: argparse.Namespace, plan: Plan) -> list[Record]:
    from rsenf.batch.journal import read_records
    from rsenf.bench.discover.beside import tried
    from rsenf.bench.session import measure_missing
    from rsenf.cli.bench import grids_of
    from rsenf.cli.console import progress_bar

    if args.table_only:
        return list(read_records(args.out / _RECORDS).values())
    cases, grids = plan.cases() + clock_cases_of(args, plan), grids_of(args)
    with tempfile.TemporaryDirectory() as temporary:
        out = (args.out or Path(temporary)) / _RECORDS
        with progress_bar("hiding and finding", float(len(cases))) as bar:
            return measure_missing(
                cases,
                partial(tried, grids=grids),
                out,
                max(args.jobs, 1),
                lambda done, missing: bar(float(len(cases) - missing + done)),
            )
