"""Follows a growing table: yields rows as they are written, through truncation and rotation."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from rsenf.errors import ReferenceFormatError, UsageError
from rsenf.messages import ReferenceBlock
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.reference.axis import find_raster
from rsenf.reference.live.growing import Growing
from rsenf.reference.plausible import Unit, nominal_of, unit_of, without_outliers
from rsenf.reference.readings import ReadOptions, TimedRows
from rsenf.reference.reference import Notes
from rsenf.reference.table import table_columns
from rsenf.timebase import NO_ZONE, NS_PER_S

PIECE_BYTES = 1 << 22
# A header and some rows, enough to find the columns and the step between rows.
ENOUGH_LINES = 5
_LINE = re.compile(rb"^[^#\s].*\n", re.MULTILINE)  # without comments
_NO_LINES = (".gz", ".parquet", ".pq", ".npz", ".wav")

Wait = Callable[[], bool]


def follow_table(
    path: Path, grid: str, options: ReadOptions, wait: Wait, run_id: str = ""
) -> Iterator[ReferenceBlock]:
    """Return a table's readings as blocks, and continue as it grows.

    Parameters
    ----------
    path : Path
        CSV with dated times; its present content comes first.
    grid : str
        Name of the reference.
    options : ReadOptions
    wait : callable
        Called when there is nothing new; waits a while, and returns whether to stop.
    run_id : str
        Identity of the run.

    Raises
    ------
    UsageError
        If there is no such file, or a file of its kind doesn't grow line by line.
    ReferenceFormatError
        If it can't be read as a reference, or has no dated times.
    """
    if not path.is_file():
        raise UsageError(f"no reference file {path}", "look for a misspelling")
    if path.suffix.lower() in _NO_LINES:
        raise UsageError(f"{path.name} doesn't grow line by line", "only CSV and WAV are followed")
    return _followed(path, grid, options, wait, run_id)


def _followed(
    path: Path, grid: str, options: ReadOptions, wait: Wait, run_id: str
) -> Iterator[ReferenceBlock]:
    growing: Growing | None = None
    for text in _generations(path, wait):
        notes = Notes()
        rows = TimedRows(path.name, options, notes)
        unit: Unit | None = None
        for columns in table_columns(text, path.name, options.column, notes, options.time_column):
            if columns.time is None:
                raise _undated(path)
            t_ns, freq_hz = rows.read(columns, more=True)
            rows.check()
            if not rows.dated:
                raise _undated(path)
            if not t_ns.size:
                continue
            unit = unit or unit_of(
                freq_hz, columns.frequency_name, path.name, options.deviations_from_hz, notes
            )
            freq_hz = unit.to_hz(freq_hz)
            growing = growing or _begun(path, grid, options, run_id, t_ns, freq_hz)
            growing.zone_unknown = NO_ZONE in notes.lines
            if options.stamp == "centre":
                t_ns = t_ns - growing.step_ns // 2
            freq_hz = without_outliers(freq_hz, growing.nominal_hz, notes)
            yield from growing.stamped(t_ns, freq_hz, growing.nominal_hz)


def _begun(
    path: Path,
    grid: str,
    options: ReadOptions,
    run_id: str,
    t_ns: Int64Array,
    freq_hz: FloatArray,
) -> Growing:
    """Begin a reference from its first rows: nominal frequency, step, and raster."""
    nominal_hz = nominal_of(freq_hz, path.name, options.nominal_hz)
    raster = find_raster(t_ns, options.step_s, path.name)
    growing = Growing(grid, raster.step_ns / NS_PER_S, run_id)
    centre_ns = raster.step_ns // 2 if options.stamp == "centre" else 0
    growing.begin(raster.t0_ns - centre_ns, nominal_hz)
    return growing


def _undated(path: Path) -> ReferenceFormatError:
    return ReferenceFormatError(
        f"{path.name} has no times of day", "a file that grows must tell when each value was"
    )


def _generations(path: Path, wait: Wait) -> Iterator[Iterator[str]]:
    """Yield the file's text, and again after each truncation or replacement."""
    stopped = False

    def pause() -> bool:
        nonlocal stopped
        stopped = stopped or wait()
        return stopped

    while not stopped:
        try:
            file = path.open("rb")
        except OSError:  # removed, and not yet replaced
            pause()
            continue
        with file:
            text = _whole_lines(file, path, pause)
            if first := next(text, ""):
                yield itertools.chain([first], text)


def _whole_lines(file: BinaryIO, path: Path, pause: Wait) -> Iterator[str]:
    """Yield new text of a file in whole lines, until the file is replaced or the caller stops."""
    rest, enough = b"", False
    while True:
        new = file.read(PIECE_BYTES)
        rest += new
        end = rest.rfind(b"\n") + 1
        enough = enough or len(_LINE.findall(rest)) >= ENOUGH_LINES
        if enough and end:
            yield rest[:end].decode("utf-8-sig", errors="replace")
            rest = rest[end:]
        if not new and (is_another(path, file, file.tell()) or pause()):
            return


def is_another(path: Path, file: BinaryIO, least_bytes: int) -> bool:
    """Whether an open file was truncated, or replaced by another of that name.

    Parameters
    ----------
    path : Path
    file : BinaryIO
    least_bytes : int
        Size below which it was truncated.
    """
    ours = os.fstat(file.fileno())
    try:
        now = path.stat()
    except OSError:
        return False  # removed; a new one may follow
    return now.st_ino != ours.st_ino or now.st_size < least_bytes
