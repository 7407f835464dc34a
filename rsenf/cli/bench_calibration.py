"""``rsenf bench calibration``: how reliable the matcher's likelihood ratios are, or new ones."""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.batch.journal import Record

_SEARCHES, _QUICK = 400, 12
_RECORDS = "calibration.jsonl"


def run(args: argparse.Namespace) -> int:
    """Test the calibration that comes with the package; with ``--fit`` make a new one.

    Raises
    ------
    UsageError
        When the measured grids aren't there.
    """
    from rsenf.bench.calibration.grids import FIT, TEST
    from rsenf.bench.calibration.picture import draw
    from rsenf.bench.calibration.table import calibration_file, fitted_lines, tabulated, text
    from rsenf.cli.console import note, print_json
    from rsenf.errors import EXIT_DONE
    from rsenf.match.calibration import calibration
    from rsenf.whole_file import whole_file

    records = _records(args, FIT if args.fit else TEST)
    lines = fitted_lines(records) if args.fit else calibration().lines
    document = tabulated(lines, records)
    if args.fit:
        with whole_file(args.fit) as temporary:
            temporary.write_text(json.dumps(calibration_file(lines, records), indent=2) + "\n")
    if args.picture:
        draw(args.picture, document)
        note(f"picture: {args.picture}")
    if args.json:
        print_json(document)
    else:
        print(text(document))
    return EXIT_DONE


def _records(args: argparse.Namespace, part: str) -> list[Record]:
    from rsenf.bench.calibration.searches import Search, searched
    from rsenf.bench.session import measure_missing
    from rsenf.cli.bench import grids_of
    from rsenf.cli.console import progress_bar
    from rsenf.errors import UsageError

    folder = grids_of(args)
    if folder is None:
        raise UsageError("calibration needs measured grids", "name their folder with --grids")
    first = args.first_seed or 0
    count = args.clips or (_QUICK if args.quick else _SEARCHES)
    tasks = [Search(part, seed, folder) for seed in range(first, first + count)]
    with tempfile.TemporaryDirectory() as temporary:
        out = (args.out or Path(temporary)) / _RECORDS
        with progress_bar("searching", float(count)) as bar:
            return measure_missing(
                tasks,
                searched,
                out,
                max(args.jobs, 1),
                lambda done, missing: bar(float(count - missing + done)),
            )
