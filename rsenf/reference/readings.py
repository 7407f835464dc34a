"""A file of any kind as readings, each a time and a frequency, some hundred thousand at once."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.reference.axis import Piece, Raster, find_raster
from rsenf.reference.columns import Columns, numbers
from rsenf.reference.days import read_days
from rsenf.reference.notes import Notes
from rsenf.reference.options import ReadOptions
from rsenf.reference.parquet import parquet_columns
from rsenf.reference.plausible import MIN_VALUES, nominal_of, without_outliers
from rsenf.reference.table import table_columns
from rsenf.reference.text import text_blocks
from rsenf.reference.times import TimeReader
from rsenf.reference.wav import demodulate
from rsenf.timebase import NS_PER_S, nanoseconds

HEAD_VALUES = 1000


class Stamped(NamedTuple):
    """Times (n,) as the file gives them, and frequencies (n,), NaN where there is none."""

    t_ns: Int64Array
    freq_hz: FloatArray


class Readings:
    """The readings of a file, to be iterated once; what it says of itself is known meanwhile.

    Parameters
    ----------
    path : Path
        CSV (plain or gzipped), Parquet, NPZ, or WAV of the mains; told apart by its ending.
    options : ReadOptions
    """

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path, self._options = path, options
        self._dated = True
        self.notes = Notes()
        self.nominal_hz = float("nan")
        """50 or 60, from the first piece on."""
        self.step_s = options.step_s
        """Time between samples; None, from the first piece on, when it is for the times to tell."""

    @property
    def dated(self) -> bool:
        """Whether times are UTC since 1970, from the first piece on."""
        return self._dated or bool(self._options.start_utc_ns)

    def __iter__(self) -> Iterator[Piece]:
        """Yield pieces.

        Raises
        ------
        ReferenceFormatError
            When the file can't be read as a reference.
        """
        return self._placed(self._plausible(_headed(self._stamped())))

    def _stamped(self) -> Iterator[Stamped]:
        path, options = self._path, self._options
        ending = path.suffix.lower()
        if ending == ".wav":
            return self._from_wav()
        if ending == ".npz":
            return self._from_days()
        if ending in (".parquet", ".pq"):
            return self._from_columns(parquet_columns(path, options.column))
        blocks = text_blocks(path)
        return self._from_columns(table_columns(blocks, path.name, options.column, self.notes))

    def _from_wav(self) -> Iterator[Stamped]:
        found = demodulate(self._path, self._options.nominal_hz)
        for line in found.notes:
            self.notes.say(line)
        self.step_s, self._dated = 1.0, False
        yield Stamped(np.arange(found.freq_hz.size) * NS_PER_S, found.freq_hz)

    def _from_days(self) -> Iterator[Stamped]:
        options = self._options
        days = read_days(self._path, options.timezone, options.step_s, self.notes)
        self.step_s, self._dated = days.step_s, days.dated
        for t_ns, freq_hz in days.each():
            yield Stamped(t_ns, self._counted(freq_hz))

    def _from_columns(self, columns: Iterable[Columns]) -> Iterator[Stamped]:
        parts = iter(columns)
        first = next(parts, None)
        if first is None:
            raise ReferenceFormatError(f"{self._path.name} holds no values")
        parts = itertools.chain([first], parts)
        return self._one_after_another(parts) if first.time is None else self._timed(parts)

    def _one_after_another(self, columns: Iterable[Columns]) -> Iterator[Stamped]:
        if self.step_s is None:
            raise ReferenceFormatError(
                f"{self._path.name} has no time column",
                "give the time between values with --step-s",
            )
        self._dated = False
        rows = 0
        for part in columns:
            freq = self._counted(numbers(part.frequency))
            yield Stamped(np.arange(rows, rows + freq.size) * nanoseconds(self.step_s), freq)
            rows += freq.size

    def _timed(self, columns: Iterable[Columns]) -> Iterator[Stamped]:
        times = TimeReader(self._path.name, self._options.timezone, self.notes)
        rows = usable = 0
        waiting: Columns | None = None
        for new, more in _with_more(columns):
            part = new if waiting is None else waiting + new
            read = times.read(part.time, more=more)
            now, waiting = part.split(read.t_ns.size)
            freq = self._counted(numbers(now.frequency))
            self._dated = times.absolute
            self.notes.count("rows without a time that can be used, left out", (~read.ok).sum())
            rows, usable = rows + read.ok.size, usable + int(read.ok.sum())
            yield Stamped(read.t_ns[read.ok], freq[read.ok])
        if usable < MIN_VALUES <= rows:
            raise ReferenceFormatError(
                f"{self._path.name}: rows with a time: {usable}", "at least two are needed"
            )

    def _counted(self, freq_hz: FloatArray) -> FloatArray:
        self.notes.count("values that are no numbers, taken as gaps", np.isnan(freq_hz).sum())
        return freq_hz

    def _plausible(self, parts: Iterable[Stamped]) -> Iterator[Stamped]:
        """Find the nominal frequency in the first part; let no others through."""
        for t_ns, freq_hz in parts:
            if np.isnan(self.nominal_hz):
                self.nominal_hz = nominal_of(freq_hz, self._path.name, self._options.nominal_hz)
            yield Stamped(t_ns, without_outliers(freq_hz, self.nominal_hz, self.notes))

    def _placed(self, parts: Iterable[Stamped]) -> Iterator[Piece]:
        """Find the raster in the first part; move all to a start that was given."""
        options = self._options
        raster: Raster | None = None
        move_ns = 0
        for t_ns, freq_hz in parts:
            if raster is None:
                raster = find_raster(t_ns, self.step_s, self._path.name)
                if not self._dated and options.start_utc_ns:
                    move_ns += options.start_utc_ns - int(t_ns.min())
                if self.dated and options.stamp == "centre":
                    move_ns -= raster.step_ns // 2
                raster = Raster(raster.t0_ns + move_ns, raster.step_ns)
            yield Piece(t_ns + move_ns, freq_hz, raster)


def _headed(parts: Iterable[Stamped]) -> Iterator[Stamped]:
    """Join the first parts to one that has enough values to judge the whole by."""
    parts = iter(parts)
    head: list[Stamped] = []
    enough = 0
    for part in parts:
        head.append(part)
        enough += int(np.isfinite(part.freq_hz).sum())
        if enough >= HEAD_VALUES:
            break
    yield Stamped(*map(np.concatenate, zip(*head, strict=True)))
    yield from (part for part in parts if part.t_ns.size)


def _with_more(columns: Iterable[Columns]) -> Iterator[tuple[Columns, bool]]:
    """Yield each with whether another follows."""
    last: Columns | None = None
    for part in columns:
        if last is not None:
            yield last, True
        last = part
    if last is not None:
        yield last, False
