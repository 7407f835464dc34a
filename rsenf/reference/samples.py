"""Aggregates readings by sample: one rule for duplicates, within a file and between files.

A sample keeps the number of its readings and their sum, minimum and maximum. Sets of samples merge
to the same result in any order and however they are split.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import FloatArray, Int64Array, UInt32Array
from rsenf.reference.notes import Notes

AGREE_HZ = 0.005  # readings further apart disagree
_ROUNDING_HZ = 1e-9  # so that 49.995 and 50.000 count as exactly 5 mHz apart


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
        return Samples(
            self.index[chosen],
            self.total[chosen],
            self.readings[chosen],
            self.low[chosen],
            self.high[chosen],
            self.unit_hz,
        )

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
    s = parts[0] if len(parts) == 1 else _joined(parts)
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


def _joined(parts: Sequence[Samples]) -> Samples:
    return Samples(
        np.concatenate([p.index for p in parts]),
        np.concatenate([p.total for p in parts]),
        np.concatenate([p.readings for p in parts]),
        np.concatenate([p.low for p in parts]),
        np.concatenate([p.high for p in parts]),
        parts[0].unit_hz,
    )
