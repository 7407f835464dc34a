"""Runs a batch: does what the journal lacks, then writes the Parquet table and the HTML page."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from rsenf.batch.columns import (
    FAILED,
    PAGE,
    TABLE,
    VERSION,
    Row,
    check_analysis,
    columns_of,
    is_useless,
    left_to_do,
    make_row,
    plan_words,
)
from rsenf.batch.journal import Journal
from rsenf.batch.pool import Done, Trouble, worked
from rsenf.batch.settings import JOURNAL, RecordingFile, Settings
from rsenf.batch.work import Job, work_on
from rsenf.report.batch_page import batch_page
from rsenf.report.values import setting
from rsenf.timebase import utc_text
from rsenf.whole_file import whole_file

_TYPES = {
    "text": pa.string(),
    "texts": pa.list_(pa.string()),
    "number": pa.float64(),
    "count": pa.int64(),
}


def table_rows(analysis: str, rows: Sequence[Row]) -> list[Row]:
    """Return rows of the journal with the table's columns, and with valid UTF-8."""
    return [{name: _cell(name, row) for name in columns_of(analysis)} for row in rows]


def write_parquet(path: Path, analysis: str, rows: Sequence[Row], about: dict[str, str]) -> None:
    """Write a table, completely or not at all.

    Parameters
    ----------
    path : Path
    analysis : str
    rows : sequence of dict
        As :func:`table_rows` returns them.
    about : dict of str
        Metadata, stored with the table's version under ``rsenf.…``.

    Raises
    ------
    RecordingError
        If it can't be written.
    """
    notes = {"batch_version": str(VERSION), "analysis": analysis, **about}
    schema = pa.schema(
        [(name, _TYPES[kind]) for name, kind in columns_of(analysis).items()],
        {f"rsenf.{name}": value for name, value in notes.items()},
    )
    with whole_file(path) as part:
        pyarrow.parquet.write_table(pa.Table.from_pylist(list(rows), schema), part)


def _cell(name: str, row: Row) -> Any:
    if name == "modified_utc":
        return utc_text(row["modified_ns"]) if row["modified_ns"] >= 0 else None
    value = row.get(name)
    if isinstance(value, list):
        return [_text(line) for line in value]
    return _text(value) if isinstance(value, str) else value


def _text(value: str) -> str:
    """Escape bytes of a name that aren't UTF-8."""
    return value.encode("utf-8", "backslashreplace").decode("utf-8")


Bar = Callable[[int], AbstractContextManager[Callable[[float], None]]]
_TRIES = 2  # processes that may die of a recording


def run_batch(
    settings: Settings,
    recordings: Sequence[RecordingFile],
    *,
    jobs: int,
    scheduler: str = "",
    timeout_s: float = math.inf,
    retry: bool = False,
    say: Callable[[str], None],
    bar: Bar,
) -> list[Row]:
    """Analyse recordings; write the table and the page, and return their rows.

    Parameters
    ----------
    settings : Settings
        Checked.
    recordings : sequence of RecordingFile
    jobs : int
        Number of processes on this machine.
    scheduler : str
        Address of a Dask cluster to use instead.
    timeout_s : float
        Longest time for a recording.
    retry : bool
        Whether to do unusable recordings again, though unchanged.
    say : callable
        Called with a text on what is to be done.
    bar : callable
        From the number of recordings left to a context manager of a progress function, which is
        called with the number done.

    Raises
    ------
    UsageError
        If the folder holds results of another analysis.
    """
    out, analysis = Path(settings.out), settings.analysis
    with Journal(out / JOURNAL) as journal:
        check_analysis(analysis, journal.records.values(), out)
        todo, reasons = left_to_do(recordings, journal.records, settings.fingerprint, retry=retry)
        doing = {recording.key for recording in todo}
        passed = journal.of(r.key for r in recordings if r.key not in doing)
        useless = sum(is_useless(row) for row in passed)
        say(plan_words(len(recordings), len(todo), reasons, useless))
        tasks = [Job(recording, settings) for recording in todo]
        try:
            with bar(len(todo)) as progress:
                for number, done in enumerate(_done(tasks, jobs, scheduler, timeout_s, say), 1):
                    journal.add(_row(done))
                    progress(number)
        except KeyboardInterrupt:
            say(f"what is done is kept in {journal.path}; the same command goes on from there")
            raise
        rows = journal.of(recording.key for recording in recordings)
        _write(out, settings, rows)
    return rows


def _done(
    tasks: list[Job], jobs: int, scheduler: str, timeout_s: float, say: Callable[[str], None]
) -> Iterator[Done[Job]]:
    """Run the jobs, locally or on a cluster."""
    if scheduler and tasks:
        from rsenf.batch.pool import worked_on_cluster

        return worked_on_cluster(tasks, work_on, scheduler, say, timeout_s)
    return worked(tasks, work_on, jobs, _TRIES, timeout_s)


def _row(done: Done[Job]) -> Row:
    """Return the journal's row of a recording, with a result or without."""
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
    shown = {name: setting(value) for name, value in settings.displayed().items()}
    table = table_rows(settings.analysis, rows)
    write_parquet(out / TABLE, settings.analysis, table, shown)
    page = batch_page(settings.analysis, table, shown)
    with whole_file(out / PAGE) as part:
        part.write_text(page, encoding="utf-8")
