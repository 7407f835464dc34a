"""One import as a Parquet file.

Each row is a sample that has a reading: its start time, the sum of its readings' deviations from
the nominal frequency in whole microhertz, their number and, if there are several, their minimum and
maximum. Gaps have no rows. A row group holds samples of one block of the axis, so that a slice can
be read alone; blocks may come in any order, and more than once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.reference.samples import Samples
from rsenf.reference.store.record import record_in

if TYPE_CHECKING:
    import pyarrow as pa

UNIT_HZ = 1e-6
UNITS_PER_HZ = 1_000_000
BLOCK = 1 << 18  # samples: three days at 1 s
_READINGS = 2  # index of that column
_OF_SEVERAL = ("readings", "low_uhz", "high_uhz")  # columns of samples with more than one reading


class Group(NamedTuple):
    """A row group: ``rows`` samples of one block, from ``first`` to ``last``."""

    file: SampleFile
    number: int
    first: int
    last: int
    rows: int

    def read(self) -> Samples:
        """Read the samples."""
        return self.file.read(self.number)


class SampleFile:
    """An import in the store, open for reading.

    Raises
    ------
    ReferenceFormatError
        If it is damaged.
    SchemaMismatch
        If it has another version.
    """

    def __init__(self, path: Path) -> None:
        from pyarrow import parquet

        self.path = path
        with _legible(path):
            self._metadata = parquet.read_metadata(path)
            self.record = record_in(self._metadata.metadata, path)

    @cached_property
    def groups(self) -> list[Group]:
        """All row groups."""
        return [self._group(n) for n in range(self._metadata.num_row_groups)]

    @property
    def span_ns(self) -> tuple[int, int]:
        """Start of the first and end of the last sample, UTC since 1970."""
        first = min(group.first for group in self.groups)
        last = max(group.last for group in self.groups)
        raster = self.record.raster
        return raster.time_ns(first), raster.time_ns(last + 1)

    def _group(self, number: int) -> Group:
        group = self._metadata.row_group(number)
        times = group.column(0).statistics
        raster = self.record.raster
        first, last = ((t - raster.t0_ns) // raster.step_ns for t in (times.min_raw, times.max_raw))
        return Group(self, number, first, last, group.num_rows)

    def read(self, number: int) -> Samples:
        """Read a row group: only the columns that its statistics don't determine."""
        from pyarrow import parquet

        group, raster = self.groups[number], self.record.raster
        gaps = group.last - group.first + 1 > group.rows
        several = self._metadata.row_group(number).column(_READINGS).statistics.max > 1
        columns = ["sum_uhz", *["time"] * gaps, *_OF_SEVERAL * several]
        with _legible(self.path), parquet.ParquetFile(self.path, metadata=self._metadata) as file:
            rows = file.read_row_group(number, columns, use_threads=False)
        index = np.arange(group.first, group.last + 1)
        if gaps:
            t_ns = rows["time"].to_numpy().astype(np.int64, copy=False)
            index = (t_ns - raster.t0_ns) // raster.step_ns
        total = rows["sum_uhz"].to_numpy()
        if not several:
            once = np.broadcast_to(np.uint32(1), group.rows)
            return Samples(index, total, once, total, total, UNIT_HZ)
        low, high = (_or_total(rows[name], total) for name in ("low_uhz", "high_uhz"))
        return Samples(index, total, rows["readings"].to_numpy(), low, high, UNIT_HZ)


def schema() -> pa.Schema:
    """Return the columns of a file."""
    import pyarrow as pa

    return pa.schema(
        [
            pa.field("time", pa.timestamp("ns", "UTC"), nullable=False),
            pa.field("sum_uhz", pa.int64(), nullable=False),
            pa.field("readings", pa.uint32(), nullable=False),
            pa.field("low_uhz", pa.int32()),
            pa.field("high_uhz", pa.int32()),
        ]
    )


def _or_total(column: pa.ChunkedArray, total: Any) -> Any:
    """Return minimum or maximum readings; they are stored only if a sample has several."""
    values = column.to_numpy()
    return np.where(np.isnan(values), total, values).astype(np.int64)


@contextmanager
def _legible(path: Path) -> Iterator[None]:
    import pyarrow as pa

    try:
        yield
    except (pa.ArrowException, OSError) as exc:
        reason = str(exc).splitlines()[0].rstrip(". ")
        raise ReferenceFormatError(
            f"{path} can't be read: {reason}", "remove it, and import its original again"
        ) from None
