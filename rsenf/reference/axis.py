"""Puts time-stamped readings on one uniform axis: nothing interpolated, irregularities counted.

A sample keeps the number of its readings and their sum, minimum and maximum, which is one rule for
duplicates, within a file and between files. Sets of samples merge to the same result in any order
and however they are split.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray, Int64Array, UInt32Array
from rsenf.reference.reference import Notes
from rsenf.timebase import NS_PER_S, nanoseconds

AGREE_HZ = 0.005  # readings further apart disagree
_ROUNDING_HZ = 1e-9  # so that 49.995 and 50.000 count as exactly 5 mHz apart
OFF_GRID_RATIO = 0.02  # of the step: smaller deviations of a time stamp are not noted
MAX_SAMPLES = 200_000_000
MAX_GAP_RATIO = 1000  # samples per value; above it a date must be wrong
_USUAL_STEPS_S = (0.02, 0.04, 0.05, 0.1, 0.2, 0.25, 0.5, 1, 2, 3, 4, 5, 6, 10, 12, 15, 20, 30, 60)
_ARRAYS = ("index", "total", "readings", "low", "high")  # of samples
T = TypeVar("T", int, Int64Array)


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples that have a reading, in the order of time.

    ``index`` (n,) increases; ``total``, ``low`` and ``high`` (n,) are the sum, minimum and maximum
    of the readings, in units of ``unit_hz``; ``readings`` (n,) is their number.
    """

    index: Int64Array
    total: NDArray[Any]
    readings: UInt32Array
    low: NDArray[Any]
    high: NDArray[Any]
    unit_hz: float = 1.0

    def __len__(self) -> int:
        return self.index.size

    @property
    def repeated(self) -> NDArray[np.bool_]:
        """Which samples have more than one reading."""
        return self.readings > 1

    @property
    def agree(self) -> NDArray[np.bool_]:
        """Which samples' readings agree; the others count as gaps."""
        if self._once:
            return np.ones(len(self), np.bool_)
        apart_hz: FloatArray = (self.high - self.low) * self.unit_hz
        return apart_hz <= AGREE_HZ + _ROUNDING_HZ

    @property
    def mean(self) -> FloatArray:
        """Mean reading of each sample; exact for a single reading."""
        return self.total / self.readings

    @property
    def _once(self) -> bool:
        """Whether every sample is known to have a single reading."""
        return self.high is self.low

    def part(self, chosen: Any) -> Samples:
        """Return the samples chosen by a slice, a mask or an index array."""
        return replace(self, **{name: getattr(self, name)[chosen] for name in _ARRAYS})

    def dense(self, first: int, total: int) -> tuple[FloatArray, UInt32Array]:
        """Return mean (NaN in gaps) and number of readings of ``total`` samples from ``first``."""
        freq, readings = np.full(total, np.nan), np.zeros(total, np.uint32)
        if not len(self):
            return freq, readings
        a, b = int(self.index[0]), int(self.index[-1]) + 1
        place = slice(a - first, b - first) if b - a == len(self) else self.index - first
        freq[place] = self.total if self._once else np.where(self.agree, self.mean, np.nan)
        readings[place] = self.readings
        return freq, readings

    def note(self, notes: Notes) -> None:
        """Note how many samples have several readings, and how many of these disagree."""
        notes.count("samples with more than one reading, averaged", self.repeated.sum())
        notes.count(
            f"samples whose readings disagree by more than {AGREE_HZ * 1e3:g} mHz, taken as gaps",
            (~self.agree).sum(),
        )


def gathered(index: Int64Array, values: NDArray[Any], unit_hz: float = 1.0) -> Samples:
    """Aggregate readings by the sample that each belongs to.

    Parameters
    ----------
    index : ndarray of int64, shape (n,)
    values : ndarray, shape (n,)
    unit_hz : float
        Unit of the values.

    Examples
    --------
    >>> gathered(np.array([3, 1, 3]), np.array([50.000, 50.010, 50.002])).mean.round(4).tolist()
    [50.01, 50.001]
    """
    ones = np.ones(index.size, np.uint32)
    return merged([Samples(index, values, ones, values, values, unit_hz)])


def merged(parts: Sequence[Samples]) -> Samples:
    """Merge sets of samples, at least one: samples of the same index become one."""
    s = parts[0]
    if len(parts) > 1:
        joined: Any = {n: np.concatenate([getattr(p, n) for p in parts]) for n in _ARRAYS}
        s = replace(s, **joined)
    if np.any(np.diff(s.index) < 0):
        s = s.part(np.argsort(s.index, kind="stable"))
    starts = np.flatnonzero(np.diff(s.index, prepend=s.index[:1] - 1))
    if starts.size == len(s):
        return s
    return Samples(
        s.index[starts],
        np.add.reduceat(s.total, starts),
        np.add.reduceat(s.readings, starts),
        np.minimum.reduceat(s.low, starts),
        np.maximum.reduceat(s.high, starts),
        s.unit_hz,
    )


@dataclass(frozen=True, eq=False)
class Axis:
    """Values on a uniform axis that starts at ``t0_ns``."""

    t0_ns: int
    step_ns: int
    freq_hz: FloatArray
    readings: UInt32Array
    notes: list[str]


@dataclass(frozen=True)
class Raster:
    """The times at which samples begin: ``t0_ns``, and every ``step_ns`` before and after it.

    Examples
    --------
    >>> Raster(0, 1_000_000_000).nearest(np.array([1_400_000_000, 1_600_000_000])).tolist()
    [1, 2]
    """

    t0_ns: int
    step_ns: int

    def nearest(self, t_ns: Int64Array) -> Int64Array:
        """Return the number of the sample that begins nearest to each time."""
        return (t_ns - self.t0_ns + self.step_ns // 2) // self.step_ns

    def time_ns(self, index: T) -> T:
        """Return the start times of samples."""
        return index * self.step_ns + self.t0_ns


@dataclass(frozen=True, eq=False)
class Piece:
    """Consecutive readings, in the order of the file.

    ``t_ns`` (n,) are the start times of their samples, each near a time of the raster; ``freq_hz``
    (n,) is NaN where there is no reading.
    """

    t_ns: Int64Array
    freq_hz: FloatArray
    raster: Raster


class Placing:
    """Assigns time stamps to samples of a raster, piece by piece, and counts irregularities.

    Parameters
    ----------
    raster : Raster
    where : str
    """

    def __init__(self, raster: Raster, where: str) -> None:
        self.raster, self._where = raster, where
        self.values = self._off = self._off_most_ns = 0
        self._last_ns = np.iinfo(np.int64).min
        self._disorder = False
        self.first, self.last = np.iinfo(np.int64).max, np.iinfo(np.int64).min

    def place(self, t_ns: Int64Array) -> Int64Array:
        """Return the sample number of each time stamp."""
        index = self.raster.nearest(t_ns)
        off_ns = np.abs(t_ns - self.raster.t0_ns - index * self.raster.step_ns)
        self._off += int((off_ns > OFF_GRID_RATIO * self.raster.step_ns).sum())
        self._off_most_ns = max(self._off_most_ns, int(off_ns.max()))
        self._disorder |= bool(t_ns[0] < self._last_ns or np.any(np.diff(t_ns) < 0))
        self._last_ns = t_ns[-1]
        self.values += t_ns.size
        self.first, self.last = min(self.first, int(index.min())), max(self.last, int(index.max()))
        return index

    @property
    def total(self) -> int:
        """Number of samples from the first to the last."""
        return self.last - self.first + 1

    def check(self) -> None:
        """Refuse time stamps whose span is implausible for the number of values.

        Raises
        ------
        ReferenceFormatError
        """
        if self.total > MAX_GAP_RATIO * max(self.values, 1000):
            days = self.total * self.raster.step_ns / NS_PER_S / 86400
            raise ReferenceFormatError(
                f"{self._where}: {self.values} values span {days:.0f} days", "look for a wrong date"
            )

    def note(self, notes: Notes) -> None:
        """Add the irregularities to the notes."""
        if self._disorder:
            notes.say("rows not in the order of time: sorted")
        if self._off:
            notes.count(
                f"time stamps off the {self.raster.step_ns / NS_PER_S:g} s grid by up to "
                f"{self._off_most_ns / NS_PER_S:.3g} s, taken for the nearest sample",
                self._off,
            )


def to_axis(pieces: Iterable[Piece], where: str) -> Axis:
    """Sort stamped values onto a uniform axis, the raster of the first piece.

    Parameters
    ----------
    pieces : iterable of Piece
    where : str

    Raises
    ------
    ReferenceFormatError
        If the span of the time stamps is implausible, or needs too much memory.
    """
    placing: Placing | None = None
    index, freq = [], []
    for piece in pieces:
        placing = placing or Placing(piece.raster, where)
        placed, ok = placing.place(piece.t_ns), np.isfinite(piece.freq_hz)
        index.append(placed[ok])
        freq.append(piece.freq_hz[ok])
    if placing is None:
        raise ReferenceFormatError(f"{where} holds no values")
    placing.check()
    if placing.total > MAX_SAMPLES:
        raise ReferenceFormatError(
            f"{where}: {placing.total} samples are too many to hold at once",
            "import it, and use store:GRID in its place: rsenf reference import --help",
        )
    samples = gathered(np.concatenate(index), np.concatenate(freq))
    notes = Notes()
    placing.note(notes)
    samples.note(notes)
    raster = placing.raster
    freq_hz, readings = samples.dense(placing.first, placing.total)
    t0_ns = raster.time_ns(placing.first)
    return Axis(t0_ns, raster.step_ns, freq_hz, readings, notes.lines)


def find_raster(t_ns: Int64Array, step_s: float | None, where: str) -> Raster:
    """Find the step between samples, and where they begin, from some of their time stamps.

    They begin at the first stamp, shifted by the median deviation in case the first is off the
    raster of the others.

    Parameters
    ----------
    t_ns : ndarray of int64, shape (n,)
    step_s : float, optional
        Time between samples; the usual one nearest to the median difference if None.
    where : str

    Raises
    ------
    ReferenceFormatError
        If all stamps are equal and no step is given.
    """
    t_ns = np.sort(t_ns)
    raster = Raster(
        int(t_ns[0]), nanoseconds(step_s) if step_s is not None else _usual_step_ns(t_ns, where)
    )
    for _ in range(2):
        off_ns = t_ns - raster.t0_ns - raster.nearest(t_ns) * raster.step_ns
        shift_ns = int(np.median(off_ns))
        if abs(shift_ns) <= OFF_GRID_RATIO * raster.step_ns:
            break
        raster = Raster(raster.t0_ns + shift_ns, raster.step_ns)
    return raster


def _usual_step_ns(t_ns: Int64Array, where: str) -> int:
    steps = np.diff(t_ns)
    steps = steps[steps > 0]
    if not steps.size:
        raise ReferenceFormatError(
            f"{where}: all values have the same time", "give the time between them with --step-s"
        )
    step_s = float(np.median(steps)) / NS_PER_S
    near = min(_USUAL_STEPS_S, key=lambda usual: abs(usual - step_s))
    return nanoseconds(near if abs(near - step_s) < 0.02 * near else round(step_s, 3)) or 1
