"""Folders of the store: each holds a series, the imports of one grid at one step.

What a series holds is told block by block: gaps, repeated and contradictory samples.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rsenf.errors import ReferenceFormatError, UsageError
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.reference.axis import Samples, merged
from rsenf.reference.store.sample_file import (
    BLOCK,
    MEAN_OF,
    UNIT_HZ,
    Group,
    ImportRecord,
    SampleFile,
    means_of,
)
from rsenf.timebase import NS_PER_S, utc_text

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
LONGEST_GAPS = 5


class StoredSeries:
    """Imports of one grid at one step, as one series of samples numbered from 1970.

    Attributes
    ----------
    files : tuple of SampleFile
    grid, name : str
        Name of the grid, and with the step: the form that users give.
    nominal_hz : float
        50 or 60.
    raster : Raster
        The times at which samples begin.
    step_s : float
        Time between samples.

    Raises
    ------
    ReferenceFormatError
        If the files don't belong to one series.
    """

    def __init__(self, files: tuple[SampleFile, ...]) -> None:
        first = files[0].record
        for file in files[1:]:
            if (file.record.nominal_hz, file.record.raster) != (first.nominal_hz, first.raster):
                raise ReferenceFormatError(
                    f"{file.path} is of another series than {files[0].path.name} beside it",
                    "remove one of them",
                )
        self.files, self.grid, self.nominal_hz = files, first.grid, first.nominal_hz
        self.raster, self.step_s = first.raster, first.step_ns / NS_PER_S
        self.name = f"{self.grid}@{self.step_s:g}"

    @cached_property
    def groups(self) -> dict[int, list[Group]]:
        """Row groups by their block number, in the order of time."""
        found: dict[int, list[Group]] = {}
        for file in self.files:
            for group in file.groups:
                found.setdefault(group.first // BLOCK, []).append(group)
        return dict(sorted(found.items()))

    @property
    def first(self) -> int:
        """Number of the first sample."""
        return min(g.first for groups in self.groups.values() for g in groups)

    @property
    def last(self) -> int:
        """Number of the last sample."""
        return max(g.last for groups in self.groups.values() for g in groups)

    @property
    def span_ns(self) -> tuple[int, int]:
        """Start of the first and end of the last sample, UTC since 1970."""
        return self.raster.time_ns(self.first), self.raster.time_ns(self.last + 1)

    def block(self, number: int) -> Samples:
        """Read one of the blocks in :attr:`groups`."""
        parts = [group.read() for group in self.groups[number]]
        return merged(parts) if len(parts) > 1 else parts[0]

    def means(self, number: int) -> FloatArray:
        """Return a block's means of ``MEAN_OF`` samples each, in units; NaN in gaps.

        Read from the files if they hold them and none is of samples from two imports.
        """
        here = range(number * BLOCK // MEAN_OF, (number + 1) * BLOCK // MEAN_OF)
        groups = sorted(self.groups[number], key=lambda group: group.first)
        apart = all(a.means.stop <= b.means.start for a, b in pairwise(groups))
        if not apart or not all(group.has_means for group in groups):
            return means_of(self.block(number), here)
        out = np.full(len(here), np.nan)
        for group in groups:
            first = group.means.start - here.start
            out[first : first + len(group.means)] = group.read_means()
        return out

    def __str__(self) -> str:
        start, end = map(utc_text, self.span_ns)
        return f"{self.name}, {start} to {end}"


def default_store() -> Path:
    """Default folder of the store: ``$RSENF_STORE``, or the platform's folder for user data."""
    if named := os.environ.get("RSENF_STORE"):
        return Path(named)
    if sys.platform == "darwin":
        data = Path.home() / "Library" / "Application Support"
    elif sys.platform == "win32":
        data = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
    return data / "rsenf" / "store"


def series_folder(store: Path, grid: str, step_ns: int) -> Path:
    """Return the folder of a grid's imports at one step."""
    return store / grid / f"{step_ns / NS_PER_S:g}s"


def checked_name(grid: str) -> str:
    """Return the name of a grid, if it is valid.

    Raises
    ------
    UsageError
        If it can't be the name of a folder.
    """
    if not _NAME.fullmatch(grid):
        raise UsageError(
            f"{grid!r} is no name for a grid", "1 to 64 letters, digits, '-', '_' and '.'"
        )
    return grid


def all_series(store: Path, grid: str = "*") -> list[StoredSeries]:
    """Open all series of a grid, or of all grids, sorted by name and from the finest step."""
    folders = sorted({path.parent for path in store.glob(f"{grid}/*/*.parquet")})
    files = [tuple(map(SampleFile, _imports(folder))) for folder in folders]
    return sorted(map(StoredSeries, filter(None, files)), key=lambda s: (s.grid, s.raster.step_ns))


def any_records(store: Path, grid: str) -> list[ImportRecord]:
    """Return one record per series of a grid, for what its imports have in common."""
    files = (next(_imports(folder), None) for folder in sorted((store / grid).glob("*")))
    return [SampleFile(path).record for path in files if path]


def find_series(store: Path, name: str) -> list[StoredSeries]:
    """Open ``GRID@STEP``, or all steps of ``GRID`` from the finest on; at least one.

    Raises
    ------
    UsageError
        If there is none; the message lists those that exist.
    """
    grid, _, step = name.partition("@")
    step_s = _seconds(step, name) if step else None
    found = all_series(store, checked_name(grid))
    if not found:
        grids = sorted({s.grid for s in all_series(store)})
        there = f"there are {', '.join(grids)}" if grids else "it is empty"
        raise UsageError(
            f"no grid {grid!r} in the store {store}: {there}", "rsenf reference import adds one"
        )
    chosen = [s for s in found if step_s in (None, s.step_s)]
    if not chosen:
        steps = ", ".join(s.name for s in found)
        raise UsageError(f"no {name} in the store {store}", f"there is {steps}")
    return chosen


def _seconds(step: str, name: str) -> float:
    try:
        return float(step.removesuffix("s"))
    except ValueError:
        raise UsageError(
            f"{name!r}: {step!r} is no step in seconds", "e.g. ce@1 or ce@0.1"
        ) from None


def _imports(folder: Path) -> Iterator[Path]:
    """Finished imports; the name of an unfinished one begins with a dot."""
    return (p for p in sorted(folder.glob("*.parquet")) if not p.name.startswith("."))


class SampleGap(NamedTuple):
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
    longest: tuple[SampleGap, ...]
    repeated: int
    contradicted: int
    mean_hz: float
    std_hz: float


class _Gaps:
    """Counts gaps and keeps the longest, from the samples with a value in order."""

    def __init__(self, first: int) -> None:
        self._next = first
        self.count = 0
        self.longest: list[SampleGap] = []

    def add(self, index: Int64Array) -> None:
        """Take the next samples that have a value."""
        missing = np.diff(index, prepend=self._next - 1) - 1
        before = np.flatnonzero(missing)
        self.count += before.size
        most = before[np.argsort(-missing[before], kind="stable")[:LONGEST_GAPS]]
        found = [SampleGap(int(missing[i]), int(index[i] - missing[i])) for i in most]
        ordered = sorted([*self.longest, *found], key=lambda gap: (-gap.samples, gap.first))
        self.longest = ordered[:LONGEST_GAPS]
        self._next = int(index[-1]) + 1


def facts(series: StoredSeries) -> Facts:
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


def coverage(series: StoredSeries) -> float:
    """Share of a series' samples that were measured, mostly from metadata alone."""
    measured = (
        groups[0].rows if len(groups) == 1 else len(series.block(number))
        for number, groups in series.groups.items()
    )
    return sum(measured) / (series.last - series.first + 1)
