"""Measure the errors of all methods on the same simulated clips, and print a table.

Each clip is simulated once by the capture model, encoded at every bit rate in the same pass by
x264, decoded and sampled. All methods see the same rows, and are compared with the Cramér–Rao
bound. With --out, results are kept clip by clip, and a stopped run resumes. A second of 720p takes
about 0.5 s of one core. 'rsenf bench TABLE --help' lists the options of a table.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.cli.console import note, progress_bar, say, tell
from rsenf.cli.options import add_settings, count, many, positive, settings_of
from rsenf.errors import EXIT_DONE, EXIT_FAILED, UsageError

if TYPE_CHECKING:
    from rsenf.bench.harness import Made

# Measured grids are not part of the project; next to a checkout they are in this folder.
_GRIDS = Path("../shared/data")


def add_bench(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.bench import BENCHMARKS

    kinds: dict[str, dict[str, Any]] = {
        "count": {"type": count, "metavar": "N"},
        "seconds": {"type": positive, "metavar": "S"},
        "words": {"type": many(str), "metavar": "LIST"},
        "file": {"type": Path, "metavar": "FILE"},
        "flag": {"action": "store_true"},
        "": {},
    }
    tables = parser.add_subparsers(dest="table", metavar="TABLE", required=True)
    for name, bench in BENCHMARKS.items():
        table = tables.add_parser(name, help=bench.line, description=bench.line)
        table.add_argument("--out", type=Path, metavar="DIR", help="keep results there, and resume")
        table.add_argument("--quick", action="store_true", help="a few short clips")
        table.add_argument(
            "--table-only", action="store_true", help="measure nothing: the clips that --out has"
        )
        table.add_argument("--jobs", **kinds["count"], default=2, help="processes (2)")
        table.add_argument(
            "--grids", type=Path, metavar="DIR",
            help=f"measured grids ({_GRIDS} where it is there; synthetic otherwise)",
        )  # fmt: skip
        how = table.add_mutually_exclusive_group()
        how.add_argument("--json", action="store_true")
        how.add_argument("--markdown", action="store_true", help="for a page")
        for option, given in bench.options.items():
            words = {key: value for key, value in given.items() if key != "kind"}
            table.add_argument(f"--{option}", **kinds[given.get("kind", "")] | words)
        if plan := bench.settings():
            given = {"also": bench.also, "leave_out": ("part",), **bench.usual}
            add_settings(table, "clips", plan, **given)
        else:
            table.add_argument("--seed", **kinds["count"], default=0, help="first (0)")


def run_bench(args: argparse.Namespace) -> int:
    """Measure the missing results, and print the table.

    Raises
    ------
    UsageError
        For contradictory or invalid options.
    """
    from rsenf.bench import BENCHMARKS
    from rsenf.bench.harness import BenchRun

    if args.table_only and not args.out:
        raise UsageError("--table-only without --out", "name their folder")
    args.grids = args.grids or (_GRIDS if _GRIDS.is_dir() else None)
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.out or Path(temporary)
        bench = BENCHMARKS[args.table]
        usual = bench.quick if args.quick else bench.usual
        settings = partial(settings_of, args, bench.settings() or object, **usual)
        made = bench.made(BenchRun(args, folder, settings, say, note, _counting))
        _write_files(args, made)
    document = made.document
    tell(args, document, "" if args.json else made.text(document, on_page=args.markdown))
    broke = sum(row.get("broke", 0) for row in document.get("rows", ()))
    if broke:
        say(f"methods broke {broke} times: see 'broke' in the results")
    return EXIT_FAILED if broke else EXIT_DONE


@contextmanager
def _counting(what: str, total: int) -> Iterator[Callable[[int, int], None]]:
    """Print how many results are missing, and show a progress bar."""
    with progress_bar(what, total, unit=f"of {total}") as bar:

        def progress(done: int, missing: int) -> None:
            if not done:
                say(f"{what}: {missing} of {total}")
            bar(total - missing + done)

        yield progress


def _write_files(args: argparse.Namespace, made: Made) -> None:
    """Write the fitted file and the picture that the options ask for."""
    from rsenf.whole_file import whole_file

    if made.fitted and args.fit:
        with whole_file(args.fit) as temporary:
            temporary.write_text(json.dumps(made.fitted(), indent=2) + "\n", encoding="utf-8")
        note(f"fitted: {args.fit}")
    if made.draw and args.picture:
        made.draw(args.picture, made.document)
        note(f"picture: {args.picture}")
