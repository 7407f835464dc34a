"""Reads a file of any format as readings, time and frequency, some 100 000 at a time.

:class:`ReadOptions` tells what the file doesn't state itself.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np

from rsenf.errors import ReferenceFormatError, UsageError
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.reference.axis import Piece, Raster, find_raster
from rsenf.reference.columns import Columns, numbers, says_utc
from rsenf.reference.days import DAY_S, LEAST_STEP_S, read_days
from rsenf.reference.local_time import zone_of
from rsenf.reference.plausible import MIN_VALUES, Unit, nominal_of, unit_of, without_outliers
from rsenf.reference.reference import Notes
from rsenf.reference.table import parquet_columns, table_columns, text_blocks
from rsenf.reference.times import TimeReader, checked_format
from rsenf.reference.wav import demodulate
from rsenf.timebase import NS_PER_S, nanoseconds

Stamp = Literal["start", "centre"]
HEAD_VALUES = 1000


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options of reading.

    Parameters
    ----------
    timezone : str, optional
        IANA name of the zone of times that have none; UTC if None.
    step_s : float, optional
        Time between samples; needed if there is no time column.
    column : str, optional
        Name of the frequency column, if it isn't one of the usual names.
    time_column : str, optional
        Name of the time column, if it isn't found by its name or content.
    time_format : str, optional
        Format of the times, as in ``strptime``, such as %d/%m/%Y %H:%M:%S.
    nominal_hz : float, optional
        50 or 60; found from the values if None, unless they are deviations from it.
    stamp : {'start', 'centre'}
        The part of a sample's interval that its time stamp denotes.
    assumed_hz : float, optional
        Nominal frequency of deviations if ``nominal_hz`` is None; other values may differ from it.
    start_utc_ns : int
        Start of a reference without dated times, UTC since 1970; 0 for unknown.

    Raises
    ------
    UsageError
        If an option is invalid.
    """

    timezone: str | None = None
    step_s: float | None = None
    column: str | None = None
    time_column: str | None = None
    time_format: str | None = None
    nominal_hz: float | None = None
    stamp: Stamp = "start"
    assumed_hz: float | None = None
    start_utc_ns: int = 0

    @property
    def deviations_from_hz(self) -> float | None:
        """Nominal frequency that deviations refer to; None if it isn't given."""
        return self.nominal_hz or self.assumed_hz

    def __post_init__(self) -> None:
        if self.stamp not in get_args(Stamp):
            raise UsageError(f"no stamp {self.stamp!r}", "one of start, centre")
        if self.step_s is not None and not LEAST_STEP_S <= self.step_s < DAY_S:
            raise UsageError(f"a step of {self.step_s:g} s between samples", "give it in seconds")
        if self.nominal_hz not in (None, 50, 60):
            raise UsageError(f"nominal frequency {self.nominal_hz} Hz", "50 or 60")
        if self.timezone is not None:
            zone_of(self.timezone)
        if self.time_format is not None:
            checked_format(self.time_format)


class Stamped(NamedTuple):
    """Times (n,) as in the file, and frequencies (n,), NaN where there is none."""

    t_ns: Int64Array
    freq_hz: FloatArray


class Readings:
    """The readings of a file, to be iterated once; its properties are known after the first piece.

    Parameters
    ----------
    path : Path
        CSV (plain or gzipped), Parquet, NPZ, or WAV of the mains; distinguished by the extension.
    options : ReadOptions
    """

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path, self._options = path, options
        self._dated = True
        self._column = ""
        self._unit = Unit()
        self.notes = Notes()
        self.nominal_hz = float("nan")
        """50 or 60, from the first piece on."""
        self.step_s = options.step_s
        """Time between samples; None, from the first piece on, when it is for the times to tell."""

    @property
    def dated(self) -> bool:
        """Whether times are UTC since 1970; known after the first piece."""
        return self._dated or bool(self._options.start_utc_ns)

    def __iter__(self) -> Iterator[Piece]:
        """Yield pieces.

        Raises
        ------
        ReferenceFormatError
            If the file can't be read as a reference.
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
            return self._from_columns(parquet_columns(path, options.column, options.time_column))
        return self._from_columns(
            table_columns(
                text_blocks(path), path.name, options.column, self.notes, options.time_column
            )
        )

    def _from_wav(self) -> Iterator[Stamped]:
        freq_hz = demodulate(self._path, self._options.nominal_hz, self.notes)
        self.step_s, self._dated = 1.0, False
        yield Stamped(np.arange(freq_hz.size) * NS_PER_S, freq_hz)

    def _from_days(self) -> Iterator[Stamped]:
        options = self._options
        days = read_days(self._path, options.timezone, options.step_s, self.notes)
        self.step_s, self._dated = days.step_s, days.dated
        for t_ns, freq_hz in days.each():
            yield Stamped(t_ns, counted(freq_hz, self.notes))

    def _from_columns(self, columns: Iterable[Columns]) -> Iterator[Stamped]:
        parts = iter(columns)
        first = next(parts, None)
        if first is None:
            raise ReferenceFormatError(f"{self._path.name} holds no values")
        self._column = first.frequency_name
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
            freq = counted(numbers(part.frequency), self.notes)
            yield Stamped(np.arange(rows, rows + freq.size) * nanoseconds(self.step_s), freq)
            rows += freq.size

    def _timed(self, columns: Iterable[Columns]) -> Iterator[Stamped]:
        rows = TimedRows(self._path.name, self._options, self.notes)
        for new, after in itertools.pairwise(itertools.chain(columns, [None])):
            assert new is not None
            stamped = rows.read(new, more=after is not None)
            self._dated = rows.dated
            yield stamped
        if rows.usable < MIN_VALUES <= rows.rows:
            raise ReferenceFormatError(
                f"{self._path.name}: rows with a time: {rows.usable}", "at least two are needed"
            )

    def _plausible(self, parts: Iterable[Stamped]) -> Iterator[Stamped]:
        """Find unit and nominal frequency in the first part; apply them to all."""
        for t_ns, freq_hz in parts:
            if np.isnan(self.nominal_hz):
                where, options = self._path.name, self._options
                self._unit = unit_of(
                    freq_hz, self._column, where, options.deviations_from_hz, self.notes
                )
                self.nominal_hz = nominal_of(self._unit.to_hz(freq_hz), where, options.nominal_hz)
            freq_hz = self._unit.to_hz(freq_hz)
            yield Stamped(t_ns, without_outliers(freq_hz, self.nominal_hz, self.notes))

    def _placed(self, parts: Iterable[Stamped]) -> Iterator[Piece]:
        """Find the raster in the first part; shift all parts to a given start."""
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


class TimedRows:
    """Reads rows of a table with a time column, part by part.

    Parameters
    ----------
    where : str
    options : ReadOptions
    notes : Notes

    Attributes
    ----------
    rows, usable : int
        Number of rows so far, and of those with a time.
    """

    def __init__(self, where: str, options: ReadOptions, notes: Notes) -> None:
        self._where, self._options, self._notes = where, options, notes
        self._times: TimeReader | None = None
        self._waiting: Columns | None = None
        self.rows = self.usable = 0

    @property
    def dated(self) -> bool:
        """Whether times are since 1970; known after the first part."""
        return self._times is None or self._times.absolute

    def check(self) -> None:
        """Refuse times whose day and month can't be distinguished so far."""
        if self._times is not None:
            self._times.check()

    def read(self, new: Columns, *, more: bool) -> Stamped:
        """Read the next rows; with ``more`` to come, only those that later rows can't affect."""
        if self._times is None:
            self._times = TimeReader(
                self._where,
                self._options.timezone,
                self._notes,
                self._options.time_format,
                utc=says_utc(new.time_name),
            )
        part = new if self._waiting is None else self._waiting + new
        read = self._times.read(part.time, more=more)
        now, self._waiting = part.split(read.t_ns.size)
        freq = counted(numbers(now.frequency), self._notes)
        lost = int((~read.ok).sum())
        self._notes.count("rows without a time that can be used, left out", lost)
        self.rows, self.usable = self.rows + read.ok.size, self.usable + read.ok.size - lost
        return Stamped(read.t_ns[read.ok], freq[read.ok])


def counted(freq_hz: FloatArray, notes: Notes) -> FloatArray:
    """Return frequencies unchanged, and note the number of those that are NaN."""
    notes.count("values that are no numbers, taken as gaps", np.isnan(freq_hz).sum())
    return freq_hz


def _headed(parts: Iterable[Stamped]) -> Iterator[Stamped]:
    """Join the first parts until there are enough values to determine unit and raster."""
    parts = iter(parts)
    head: list[Stamped] = []
    enough = 0
    for part in parts:
        head.append(part)
        enough += int(np.isfinite(part.freq_hz).sum())
        if enough >= HEAD_VALUES:
            break
    if not head:
        return
    yield Stamped(*map(np.concatenate, zip(*head, strict=True)))
    yield from (part for part in parts if part.t_ns.size)
