"""What is known of a series: what is missing, what was said twice, and what contradicts itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rsenf.messages.schema import Int64Array
from rsenf.reference.store.folder import Series
from rsenf.reference.store.sample_file import UNIT_HZ

LONGEST_GAPS = 5


class Gap(NamedTuple):
    """So many samples without a value, and the number of the first."""

    samples: int
    first: int


@dataclass(frozen=True)
class Facts:
    """Of all samples of a series, from the first that was measured to the last.

    ``valid`` of ``total`` have a value; ``gaps`` stretches have none, the ``longest`` are named.
    ``repeated`` have several readings, ``contradicted`` readings that disagree, and so no value.
    ``mean_hz`` and ``std_hz`` are over the values.
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
    """Counts gaps and keeps the longest, as samples with a value come by."""

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
    """Go through a series once, block by block."""
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
    # A last sample without a value ends a gap like any other that follows it would.
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
    """Share of a series' samples that were measured at all, mostly without reading them."""
    measured = 0
    for number, groups in series.groups.items():
        measured += groups[0].rows if len(groups) == 1 else len(series.block(number))
    return measured / (series.last - series.first + 1)
