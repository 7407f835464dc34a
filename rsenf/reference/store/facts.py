"""Statistics of a series: gaps, repeated and contradictory samples, mean and spread."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rsenf.messages.schema import Int64Array
from rsenf.reference.store.folder import Series
from rsenf.reference.store.sample_file import UNIT_HZ

LONGEST_GAPS = 5


class Gap(NamedTuple):
    """Length of a gap in samples, and the number of its first sample."""

    samples: int
    first: int


@dataclass(frozen=True)
class Facts:
    """Statistics of a series, from its first to its last measured sample.

    ``valid`` of ``total`` samples have a value; there are ``gaps`` gaps, of which ``longest`` are
    listed. ``repeated`` samples have several readings; ``contradicted`` ones have readings that
    disagree, and therefore no value. ``mean_hz`` and ``std_hz`` are over the values.
    """

    total: int
    valid: int
    gaps: int
    longest: tuple[Gap, ...]
    repeated: int
    contradicted: int
    mean_hz: float
    std_hz: float


class _Gaps:
    """Counts gaps and keeps the longest, from the samples with a value in order."""

    def __init__(self, first: int) -> None:
        self._next = first
        self.count = 0
        self.longest: list[Gap] = []

    def add(self, index: Int64Array) -> None:
        """Take the next samples that have a value."""
        missing = np.diff(index, prepend=self._next - 1) - 1
        before = np.flatnonzero(missing)
        self.count += before.size
        most = before[np.argsort(-missing[before], kind="stable")[:LONGEST_GAPS]]
        found = [Gap(int(missing[i]), int(index[i] - missing[i])) for i in most]
        ordered = sorted([*self.longest, *found], key=lambda gap: (-gap.samples, gap.first))
        self.longest = ordered[:LONGEST_GAPS]
        self._next = int(index[-1]) + 1


def facts(series: Series) -> Facts:
    """Compute the statistics of a series in one pass, block by block."""
    valid = repeated = contradicted = 0
    total_units = total_squares = 0.0
    gaps = _Gaps(series.first)
    for number in series.groups:
        samples = series.block(number)
        agree = samples.agree
        repeated += int(samples.repeated.sum())
        contradicted += int((~agree).sum())
        index, units = samples.index[agree], samples.mean[agree]
        if index.size:
            gaps.add(index)
        valid += index.size
        total_units += float(units.sum())
        total_squares += float(units @ units)
    # A gap at the end counts like any other.
    gaps.add(np.array([series.last + 1]))
    mean = total_units / valid if valid else np.nan
    variance = total_squares / valid - mean**2 if valid else np.nan
    return Facts(
        total=series.last - series.first + 1,
        valid=valid,
        gaps=gaps.count,
        longest=tuple(gaps.longest),
        repeated=repeated,
        contradicted=contradicted,
        mean_hz=float(series.nominal_hz + mean * UNIT_HZ),
        std_hz=float(np.sqrt(max(variance, 0.0))) * UNIT_HZ,
    )


def coverage(series: Series) -> float:
    """Share of a series' samples that were measured, mostly from metadata alone."""
    measured = 0
    for number, groups in series.groups.items():
        measured += groups[0].rows if len(groups) == 1 else len(series.block(number))
    return measured / (series.last - series.first + 1)
