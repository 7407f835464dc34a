"""Imports a file into the store: read in pieces, written to one file, completely or not at all."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import psutil

from rsenf import __version__
from rsenf.errors import RecordingError, ReferenceFormatError, UsageError
from rsenf.reference.axis import OFF_GRID_RATIO, Piece, Placing, Raster, Samples, gathered
from rsenf.reference.open import file_sha256
from rsenf.reference.readings import Readings, ReadOptions
from rsenf.reference.store.folder import any_records, checked_name, series_folder
from rsenf.reference.store.sample_file import (
    UNIT_HZ,
    UNITS_PER_HZ,
    ImportRecord,
    SampleFile,
    SampleWriter,
)
from rsenf.timebase import NS_PER_S
from rsenf.whole_file import whole_file

MAX_OFF_RATIO = 0.25  # of the step: largest shift of times to those of the series
NAME_DIGITS = 16  # of the file's hash
_LEFT_OVER = re.compile(r"\..*\.(\d+)\.part\.parquet")


@dataclass(frozen=True)
class Imported:
    """Result of an import; ``new`` is False if the store had that file already."""

    record: ImportRecord
    path: Path
    new: bool


def import_file(
    store: Path,
    path: Path,
    grid: str,
    options: ReadOptions,
    *,
    imported_utc: str,
    progress: Callable[[float], None] = lambda rows: None,
) -> Imported:
    """Import a reference file.

    Parameters
    ----------
    store : Path
        Folder of the store; created if it doesn't exist.
    path : Path
        Any file that :func:`rsenf.reference.read_reference` reads.
    grid : str
        Name of its grid.
    options : ReadOptions
    imported_utc : str
        Today, for the record.
    progress : callable, optional
        Called with the number of rows read so far.

    Raises
    ------
    UsageError
        If the store has that file, read with other options; or it doesn't fit the store's series.
    ReferenceFormatError
        If it can't be read as a reference, or has no dates.
    RecordingError
        If the store can't be written.
    """
    if store.exists() and not store.is_dir():
        raise UsageError(f"the store {store} is no folder", "name one with --store DIR")
    sha256 = file_sha256(path)
    checked_name(grid)
    if there := _already(store, path, grid, sha256, options):
        return there
    readings = Readings(path, options)
    pieces = iter(readings)
    first = next(pieces, None)
    if first is None or not readings.dated:
        raise ReferenceFormatError(
            f"{path.name} tells no dates, and the store is in UTC",
            "give the start of its first sample with --start",
        )
    placing = Placing(_raster(store, grid, readings.nominal_hz, first, path.name), path.name)
    raster = placing.raster
    target = series_folder(store, grid, raster.step_ns) / f"{sha256[:NAME_DIGITS]}.parquet"
    with _folder_of(target) as part, closing(SampleWriter(part, raster)) as writer:
        for piece in itertools.chain([first], pieces):
            writer.add(_samples(piece, placing, readings.nominal_hz))
            progress(placing.values)
        writer.flush()
        placing.check()
        placing.note(readings.notes)
        record = ImportRecord(
            grid=grid,
            nominal_hz=readings.nominal_hz,
            step_ns=raster.step_ns,
            phase_ns=raster.t0_ns,
            name=path.name,
            sha256=sha256,
            size_bytes=path.stat().st_size,
            options=asdict(options),
            imported_utc=imported_utc,
            rsenf=__version__,
            rows=placing.values,
            samples=writer.samples,
            notes=(*readings.notes.lines, *writer.notes.lines),
        )
        writer.finish(record)
    return Imported(record, target, True)


def _already(
    store: Path, path: Path, grid: str, sha256: str, options: ReadOptions
) -> Imported | None:
    """Return an earlier import of the same file, if there is one and no older rsenf made it."""
    for there in sorted((store / grid).glob(f"*/{sha256[:NAME_DIGITS]}.parquet")):
        file = SampleFile(there)
        record = file.record
        if record.options != asdict(options):
            raise UsageError(
                f"{path.name} is in {grid} already, read with other options",
                f"to read it anew, remove {there}",
            )
        if file.has_means:
            return Imported(record, there, False)
    return None


def _raster(store: Path, grid: str, nominal_hz: float, first: Piece, where: str) -> Raster:
    """Return the raster of the samples: that of the series, or else that of this file."""
    beside = any_records(store, grid)
    other = next((r for r in beside if r.nominal_hz != nominal_hz), None)
    if other:
        raise UsageError(
            f"{where} is of a {nominal_hz:g} Hz grid, {grid} of one of {other.nominal_hz:g} Hz",
            "import it under another name: --grid",
        )
    step_ns, phase_ns = first.raster.step_ns, first.raster.t0_ns % first.raster.step_ns
    same = next((r.raster for r in beside if r.step_ns == step_ns), None)
    if same is None:
        near = min(phase_ns, step_ns - phase_ns) <= OFF_GRID_RATIO * step_ns
        return Raster(0 if near else phase_ns, step_ns)
    off_ns = (phase_ns - same.t0_ns + step_ns // 2) % step_ns - step_ns // 2
    if abs(off_ns) > MAX_OFF_RATIO * step_ns:
        raise UsageError(
            f"{where}: samples begin {off_ns / NS_PER_S:+g} s off those that {grid} has",
            "was --stamp the same? If so, import it under another name: --grid",
        )
    return same


def _samples(piece: Piece, placing: Placing, nominal_hz: float) -> Samples:
    """Aggregate readings, as whole microhertz from the nominal frequency."""
    index, ok = placing.place(piece.t_ns), np.isfinite(piece.freq_hz)
    units = np.rint((piece.freq_hz[ok] - nominal_hz) * UNITS_PER_HZ).astype(np.int64)
    return gathered(index[ok], units, UNIT_HZ)


@contextmanager
def _folder_of(target: Path) -> Iterator[Path]:
    """Yield a temporary file to write; remove folders that stay empty."""
    folder = target.parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path in folder.glob(".*.part.parquet"):  # unfinished files of killed imports
            number = _LEFT_OVER.fullmatch(path.name)
            if number and not psutil.pid_exists(int(number[1])):
                path.unlink(missing_ok=True)
    except OSError as exc:
        raise RecordingError(
            f"can't write to {folder}: {exc.strerror or exc}", "check the store and its rights"
        ) from exc
    try:
        with whole_file(target) as part:
            yield part
    finally:
        with suppress(OSError):  # not empty, the usual case
            folder.rmdir()
            folder.parent.rmdir()
