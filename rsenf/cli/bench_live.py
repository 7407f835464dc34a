"""``rsenf bench live``: honest feeds and attacked ones, watched by the live stage and by a rule."""

from __future__ import annotations

import argparse
import json
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.batch.journal import Record
    from rsenf.bench.live.plan import LivePlan

_RECORDS, _ESTIMATES = "live.jsonl", "estimates"
_QUICK: dict[str, Any] = {"clips": 9, "duration_s": 180.0}
_GIVEN = ("first_seed", "clips", "duration_s")


def run(args: argparse.Namespace) -> int:
    """Watch what wasn't yet, and print the tables; with ``--fit``, write new limits.

    Raises
    ------
    UsageError
        For a plan that can't be meant so.
    InputError
        When no limit is high enough.
    """
    from rsenf.bench.live.fit import limits_file
    from rsenf.bench.live.picture import draw
    from rsenf.bench.live.table import tabulated
    from rsenf.bench.live.text import page, text
    from rsenf.cli.console import note, print_json
    from rsenf.errors import EXIT_DONE
    from rsenf.whole_file import whole_file

    records = _records(args, plan_of(args))
    document = tabulated(records)
    if args.fit:
        limits = limits_file(records)
        with whole_file(args.fit) as temporary:
            temporary.write_text(json.dumps(limits, indent=2) + "\n", encoding="utf-8")
        note(f"limits: {args.fit}")
    if args.picture:
        draw(args.picture, document)
        note(f"picture: {args.picture}")
    if args.json:
        print_json(document)
    else:
        print(page(document) if args.markdown else text(document))
    return EXIT_DONE


def plan_of(args: argparse.Namespace) -> LivePlan:
    """Return the plan that the arguments mean.

    Raises
    ------
    UsageError
        For what can't be meant so.
    """
    from rsenf.bench.calibration.grids import FIT, TEST
    from rsenf.bench.live.plan import LivePlan

    given = {name: getattr(args, name) for name in _GIVEN if getattr(args, name) is not None}
    part = {"part": FIT if args.fit else TEST}
    return LivePlan(**(_QUICK if args.quick else {}) | part | given)


def _records(args: argparse.Namespace, plan: LivePlan) -> list[Record]:
    from rsenf.batch.journal import read_records
    from rsenf.bench.live.trials import watched
    from rsenf.bench.session import measure_missing
    from rsenf.cli.bench import grids_of
    from rsenf.cli.console import progress_bar

    if args.table_only:
        return list(read_records(args.out / _RECORDS).values())
    feeds = plan.feeds()
    kept = args.out / _ESTIMATES if args.out else None
    with tempfile.TemporaryDirectory() as temporary:
        out = (args.out or Path(temporary)) / _RECORDS
        with progress_bar("watching", float(len(feeds))) as bar:
            return measure_missing(
                feeds,
                partial(watched, grids=grids_of(args), kept=kept),
                out,
                max(args.jobs, 1),
                lambda done, missing: bar(float(len(feeds) - missing + done)),
            )
