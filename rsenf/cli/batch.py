"""Folders and lists of recordings through one verb, into one table.

    rsenf batch verify videos/ --reference grid.csv --out results
    rsenf batch idle videos/ more/clip.mp4 --out cameras
    find /archive -name '*.mp4' -print0 | rsenf batch track --list - --out enf

Every recording ends with a result, or with the reason why it has none, in OUT: batch.parquet,
batch.html to look at, and batch.jsonl, the journal, to which each is added as it is done. Stopped,
the same command goes on from there. What has changed since is done again, and so is what failed, or
could not be read; what is of no use only with --retry. Processes of this machine do it, or with
--scheduler the workers of a Dask cluster, which must see the same folders under the same names.
'rsenf batch VERB --help' tells a verb's options.
"""

from __future__ import annotations

import argparse
import importlib
import math
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rsenf.batch.columns import Row
    from rsenf.batch.journal import Journal
    from rsenf.batch.pool import Done
    from rsenf.batch.recordings import Found, Recording
    from rsenf.cli.batch_work import Job, Settings

ANALYSES = ("verify", "idle", "track", "discover")
TABLE, PAGE = "batch.parquet", "batch.html"
_TRIES = 2  # processes that a recording may cost


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.options import count, positive
    from rsenf.cli.verify import add_reference

    verbs = parser.add_subparsers(dest="analysis", metavar="VERB", required=True)
    for name in ANALYSES:
        verb = verbs.add_parser(name, help=f"as 'rsenf {name}' does, for each recording")
        verb.add_argument("inputs", nargs="*", metavar="IN", help="recordings, and folders of them")
        verb.add_argument("--out", type=Path, metavar="DIR", required=True, help="results")
        verb.add_argument("--list", metavar="FILE", help="more of them, one a line; - for stdin")
        verb.add_argument("--jobs", type=count, metavar="N", help="processes (one for each core)")
        verb.add_argument(
            "--scheduler", metavar="ADDRESS", help="of a Dask cluster that does the work"
        )
        verb.add_argument(
            "--timeout-s", type=positive, metavar="S", help="give a recording up after so long"
        )
        verb.add_argument(
            "--retry", action="store_true", help="do what is unusable again, though unchanged"
        )
        verb.add_argument("--json", action="store_true", help="the summary as JSON")
        if name == "verify":
            add_reference(verb, required=True)
        importlib.import_module(f"rsenf.cli.{name}").add_settings(verb)


def run(args: argparse.Namespace) -> int:
    """Work through recordings.

    Raises
    ------
    UsageError
        When there is nothing to do, or it can't be meant so.
    """
    from rsenf.batch.journal import Journal
    from rsenf.batch.recordings import JOURNAL
    from rsenf.cli.batch_settings import settings_of
    from rsenf.cli.batch_summary import exit_code, print_summary, summary_of
    from rsenf.cores import cores

    found = _find(args)
    jobs = min(args.jobs or cores(), len(found.recordings))
    settings = settings_of(args, threads=1 if args.scheduler else max(1, cores() // jobs))
    with Journal(args.out / JOURNAL) as journal:
        _work(args, found.recordings, settings, journal, jobs)
        rows = journal.of(recording.key for recording in found.recordings)
        _write(args.out, settings, rows)
    summary = summary_of(args, found, rows)
    print_summary(args, summary)
    return exit_code(rows, found)


def _find(args: argparse.Namespace) -> Found:
    """Look for what is to be done."""
    from rsenf.batch.recordings import find_recordings, read_list
    from rsenf.errors import UsageError

    missing = next((path for path in args.inputs if not os.path.lexists(path)), None)
    if missing is not None:
        raise UsageError(f"{missing}: no such file or folder", "look for a misspelling")
    listed = read_list(_read(args.list), args.list) if args.list else []
    if not args.inputs and not listed:
        raise UsageError("no recordings are named", "name files and folders, or give --list FILE")
    if any(os.path.realpath(path) == os.path.realpath(args.out) for path in args.inputs):
        raise UsageError(
            f"--out {args.out} is the folder that is to be read",
            "name one of its own; it may be in it",
        )
    found = find_recordings([*args.inputs, *listed], args.out)
    if not found.recordings:
        passed = f"; {found.passed_over.total()} files are not named like one" * bool(
            found.passed_over
        )
        raise UsageError(
            f"no recordings in {', '.join([*args.inputs, *listed][:3])}{passed}",
            "name the files themselves to have them taken",
        )
    return found


def _read(name: str) -> bytes:
    from rsenf.errors import UsageError

    try:
        return sys.stdin.buffer.read() if name == "-" else Path(name).read_bytes()
    except OSError as exc:
        raise UsageError(f"--list {name}: {exc.strerror}", "give a file of paths") from exc


def _work(
    args: argparse.Namespace,
    recordings: Sequence[Recording],
    settings: Settings,
    journal: Journal,
    jobs: int,
) -> None:
    """Do what the journal doesn't have, and add it."""
    from rsenf.batch.plan import check_analysis, is_useless, left_to_do
    from rsenf.cli.batch_summary import plan_words
    from rsenf.cli.batch_work import Job
    from rsenf.cli.console import progress_bar, say

    check_analysis(args.analysis, journal.records.values(), args.out)
    left, reasons = left_to_do(recordings, journal.records, settings.fingerprint, retry=args.retry)
    doing = {recording.key for recording in left}
    passed = journal.of(r.key for r in recordings if r.key not in doing)
    useless = sum(is_useless(row) for row in passed)
    say(plan_words(len(recordings), len(left), reasons, useless))
    try:
        with progress_bar(args.analysis, len(left), "recordings") as progress:
            tasks = [Job(recording, settings) for recording in left]
            for number, done in enumerate(_done(args, tasks, jobs), 1):
                journal.add(_row(done))
                progress(number)
    except KeyboardInterrupt:
        say(f"what is done is kept in {journal.path}; the same command goes on from there")
        raise


def _done(args: argparse.Namespace, tasks: list[Job], jobs: int) -> Iterator[Done[Job]]:
    """Have recordings done, here or elsewhere."""
    from rsenf.cli.batch_work import work_on

    timeout_s = args.timeout_s or math.inf
    if args.scheduler and tasks:
        from rsenf.batch.cluster import worked_on_cluster
        from rsenf.cli.console import say

        return worked_on_cluster(tasks, work_on, args.scheduler, say, timeout_s)
    from rsenf.batch.pool import worked

    return worked(tasks, work_on, jobs, _TRIES, timeout_s)


def _row(done: Done[Job]) -> Row:
    """Return the journal's line on a recording, whatever became of it."""
    from rsenf.batch.columns import FAILED, make_row
    from rsenf.batch.pool import Trouble

    tried = {"tries": done.tries}
    if not isinstance(done.answer, Trouble):
        return done.answer | tried
    recording, settings = done.task.recording, done.task.settings
    more: dict[str, Any] = tried | ({"trace": done.answer.trace} if done.answer.trace else {})
    return make_row(
        recording, settings.analysis, settings.fingerprint, FAILED, done.answer.text, **more
    )


def _write(out: Path, settings: Settings, rows: Sequence[Row]) -> None:
    """Write the table, and the page."""
    from rsenf.batch.table import table_rows, write_parquet
    from rsenf.cli.batch_settings import told_settings
    from rsenf.report.batch_page import batch_page
    from rsenf.report.pages import setting
    from rsenf.whole_file import whole_file

    told = {name: setting(value) for name, value in told_settings(settings).items()}
    table = table_rows(settings.analysis, rows)
    write_parquet(out / TABLE, settings.analysis, table, told)
    page = batch_page(settings.analysis, table, told)
    with whole_file(out / PAGE) as part:
        part.write_text(page, encoding="utf-8")
