"""A series of the store as a reference whose samples are read lazily, in slices; and its export."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray, Int64Array, UInt32Array
from rsenf.reference.reference import Reference
from rsenf.reference.store.folder import StoredSeries, find_series
from rsenf.reference.store.sample_file import BLOCK, MEAN_OF, UNITS_PER_HZ, ImportRecord
from rsenf.timebase import NO_ZONE, nanoseconds, utc_text
from rsenf.whole_file import whole_file

if TYPE_CHECKING:
    import pyarrow as pa

CACHED_BLOCKS = 8  # 25 MB
T = TypeVar("T", np.float64, np.uint32)
ENDINGS = (".csv", ".parquet")


def _dense(series: StoredSeries, number: int) -> tuple[FloatArray, UInt32Array]:
    """Frequency (Hz, NaN in gaps) and number of readings of a block's samples."""
    freq_hz, readings = series.block(number).dense(number * BLOCK, BLOCK)
    # In whole units, so that a frequency is the double nearest to its six decimals.
    np.rint(freq_hz, out=freq_hz)
    freq_hz += series.nominal_hz * UNITS_PER_HZ
    freq_hz /= UNITS_PER_HZ
    return freq_hz, readings


def _mean_hz(series: StoredSeries, number: int) -> FloatArray:
    """Means of a block (Hz, NaN in gaps)."""
    return (series.means(number) + series.nominal_hz * UNITS_PER_HZ) / UNITS_PER_HZ


class StoredSamples(Generic[T]):
    """One value per sample, read on access: by slices, or as a whole array.

    Like a read-only ndarray of shape (n,), except that a slice is a copy.

    Parameters
    ----------
    series : StoredSeries
    block : callable
        Returns the values of a block that has samples, by its number.
    length : int
        Values in a block.
    first, size : int
        Number of the first value, counted from 1970, and of how many there are.
    gap : float64 or uint32
        Value where there is no block.
    """

    ndim = 1

    def __init__(
        self,
        series: StoredSeries,
        block: Callable[[int], NDArray[T]],
        length: int,
        *,
        first: int,
        size: int,
        gap: T,
    ) -> None:
        self._series, self._length, self._first = series, length, first
        self._block: Callable[[int], NDArray[T]] = block
        self._gap: T = gap
        self.size = size
        self.shape = (size,)
        self.dtype: np.dtype[T] = gap.dtype

    def __len__(self) -> int:
        return self.size

    def __getitem__(self, key: slice) -> NDArray[T]:
        if not isinstance(key, slice):
            raise TypeError("samples of the store are read by slices; np.asarray() reads them all")
        asked = range(self.size)[key]
        if not asked:
            return np.empty(0, self.dtype)
        a, b = min(asked[0], asked[-1]), max(asked[0], asked[-1]) + 1
        return self._read(a, b)[:: asked.step]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """Read everything."""
        return self[:].astype(dtype or self.dtype, copy=False)

    def __iter__(self) -> Iterator[T]:
        for start in range(0, self.size, BLOCK):
            yield from self[start : start + BLOCK]

    def means(self) -> tuple[int, int, StoredSamples[np.float64]]:
        """Return means for a search from coarse to fine: fast to read, of files that hold them.

        Returns
        -------
        many : int
            Samples in a mean.
        before : int
            Samples before the first mean.
        means : StoredSamples
        """
        first = -(-self._first // MEAN_OF)
        count = max((self._first + self.size) // MEAN_OF - first, 0)
        found = StoredSamples(
            self._series,
            partial(_mean_hz, self._series),
            BLOCK // MEAN_OF,
            first=first,
            size=count,
            gap=np.float64(np.nan),
        )
        return MEAN_OF, first * MEAN_OF - self._first, found

    def _read(self, start: int, stop: int) -> NDArray[T]:
        a, b, length = self._first + start, self._first + stop, self._length
        out = np.empty(b - a, self.dtype)
        for number in range(a // length, -(-b // length)):
            low, high = max(a, number * length), min(b, (number + 1) * length)
            target = out[low - a : high - a]
            if number in self._series.groups:
                target[:] = self._block(number)[low - number * length : high - number * length]
            else:
                target[:] = self._gap
        return out


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredReference(Reference):
    """A reference whose ``freq_hz`` and ``readings`` are on disk, and read by slices.

    ``measured`` (k, 2) are the ranges (first sample, one past the last) that contain samples, with
    long gaps between them. ``imports`` are the records of the files that it was made from.
    """

    freq_hz: StoredSamples[np.float64]  # type: ignore[assignment]  # like an array
    readings: StoredSamples[np.uint32]  # type: ignore[assignment]
    measured: Int64Array
    imports: tuple[ImportRecord, ...]


def stored_reference(
    series: StoredSeries, from_ns: int | None = None, to_ns: int | None = None
) -> StoredReference:
    """Open a series, or its part in a time span.

    Parameters
    ----------
    series : StoredSeries
    from_ns, to_ns : int, optional
        UTC since 1970; samples that begin at or after the first and before the second.

    Raises
    ------
    UsageError
        If it has nothing there.
    """
    raster = series.raster
    low = series.first if from_ns is None else -((raster.t0_ns - from_ns) // raster.step_ns)
    high = series.last if to_ns is None else -((raster.t0_ns - to_ns) // raster.step_ns) - 1
    first, last = max(low, series.first), min(high, series.last)
    spans = [
        (max(g.first, first), min(g.last, last) + 1)
        for groups in series.groups.values()
        for g in groups
        if g.first <= last and g.last >= first
    ]
    if not spans:
        raise UsageError(f"the store has nothing of {series.grid} then", f"it has {series}")
    first, last = min(a for a, _ in spans), max(b for _, b in spans) - 1
    size = last - first + 1
    t0_ns, end_ns = raster.time_ns(first), raster.time_ns(last + 1)
    dense = lru_cache(CACHED_BLOCKS)(partial(_dense, series))
    samples = partial(StoredSamples, series, length=BLOCK, first=first, size=size)
    hashes = sorted(f.record.sha256 for f in series.files)
    return StoredReference(
        grid=series.grid,
        nominal_hz=series.nominal_hz,
        t0_ns=t0_ns,
        step_s=series.step_s,
        freq_hz=samples(lambda number: dense(number)[0], gap=np.float64(np.nan)),
        readings=samples(lambda number: dense(number)[1], gap=np.uint32(0)),
        measured=_joined(spans) - first,
        imports=tuple(f.record for f in series.files),
        notes=(
            f"from the store: {series.name}, {utc_text(t0_ns)} to {utc_text(end_ns)}, "
            f"imports: {len(series.files)}",
            *([NO_ZONE] if any(f.record.zone_unknown for f in series.files) else []),
        ),
        sha256=hashlib.sha256("\n".join(hashes).encode()).hexdigest(),
        name=f"store:{series.name}",
    )


def open_grid(
    store: Path, name: str, from_ns: int | None = None, to_ns: int | None = None
) -> StoredReference:
    """Open ``GRID@STEP``, or the finest step of ``GRID``; times as for :func:`stored_reference`.

    Raises
    ------
    UsageError
        If there is no such grid, or it has nothing there.
    """
    series, *others = find_series(store, name)
    reference = stored_reference(series, from_ns, to_ns)
    if not others:
        return reference
    also = ", ".join(s.name for s in others)
    line = f"took the finest step of {series.grid}; there is also {also}"
    return replace(reference, notes=(*reference.notes, line))


def _joined(spans: list[tuple[int, int]]) -> Int64Array:
    joined: list[list[int]] = []
    for a, b in sorted(spans):
        if joined and a <= joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], b)
        else:
            joined.append([a, b])
    return np.array(joined, np.int64)


def export(reference: StoredReference, path: Path) -> int:
    """Write the times and values of a reference; gaps have no rows.

    Parameters
    ----------
    reference : StoredReference
    path : Path
        ``.csv`` or ``.parquet``.

    Returns
    -------
    int
        Number of values written.

    Raises
    ------
    UsageError
        For another extension.
    RecordingError
        If it can't be written.
    """
    import pyarrow as pa

    if path.suffix.lower() not in ENDINGS:
        raise UsageError(f"{path}: neither {' nor '.join(ENDINGS)}", "name the file so")
    schema = _schema(reference)
    written = 0
    with whole_file(path) as part, closing(_writer(part, schema)) as writer:
        for t_ns, freq_hz in _values(reference):
            times = pa.array(t_ns, pa.timestamp("ns", "UTC")).cast(schema.field(0).type)
            writer.write_table(pa.table([times, pa.array(freq_hz)], schema))
            written += freq_hz.size
    return written


def _values(reference: StoredReference) -> Iterator[tuple[Any, Any]]:
    """Yield times and values, without gaps, some at a time."""
    step_ns = nanoseconds(reference.step_s)
    for first, end in reference.measured.tolist():
        for a in range(first, end, BLOCK):
            freq_hz = reference.freq_hz[a : min(a + BLOCK, end)]
            there = np.flatnonzero(np.isfinite(freq_hz))
            if there.size:
                yield reference.t0_ns + (a + there) * step_ns, freq_hz[there]


def _schema(reference: StoredReference) -> pa.Schema:
    """Schema with times in the coarsest unit that represents them exactly."""
    import pyarrow as pa

    parts = (reference.t0_ns, nanoseconds(reference.step_s))
    units = (("s", 10**9), ("ms", 10**6), ("ns", 1))
    unit = next(name for name, ns in units if not any(part % ns for part in parts))
    return pa.schema([("time", pa.timestamp(unit, "UTC")), ("frequency", pa.float64())])


def _writer(path: Path, schema: pa.Schema) -> Any:
    from pyarrow import csv, parquet

    if path.suffix.lower() == ".csv":
        return csv.CSVWriter(path, schema)
    # Parquet has no unit of seconds; it stores them as milliseconds.
    return parquet.ParquetWriter(path, schema, compression="zstd")
