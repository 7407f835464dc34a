"""One import as a Parquet file, with its provenance; read by row groups, written in bounded memory.

Each row is a sample that has a reading: its start time, the sum of its readings' deviations from
the nominal frequency in whole microhertz, their number and, if there are several, their minimum and
maximum. Gaps have no rows. A row group holds samples of one block of the axis, so that a slice can
be read alone; blocks may come in any order, and more than once.

For a search from coarse to fine the first rows of a row group also hold its means of 8 samples each
(``mean_uhz``, null where fewer than half are valid), from the one with its first sample to the one
with its last; the other rows are null. Files of older versions lack them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from rsenf.errors import ReferenceFormatError, RsenfError, SchemaMismatch
from rsenf.medians import means
from rsenf.messages.schema import FloatArray
from rsenf.reference.axis import Raster, Samples, merged
from rsenf.reference.readings import ReadOptions
from rsenf.reference.reference import Notes
from rsenf.timebase import NO_ZONE

if TYPE_CHECKING:
    import pyarrow as pa

VERSION = 1  # of the format of the store's files
KEY = "rsenf"
TAKEN_AS_UTC = "times without a zone taken as UTC"
UNIT_HZ = 1e-6
UNITS_PER_HZ = 1_000_000
BLOCK = 1 << 18  # samples: three days at 1 s
MEAN_OF = 8  # samples
_READINGS = 2  # index of that column
_MEAN = "mean_uhz"
_OF_SEVERAL = ("readings", "low_uhz", "high_uhz")  # columns of samples with more than one reading
# What is raised, between them, by readers of Parquet and of JSON, and by what they find there.
_NOT_OF_THE_STORE = (
    OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError,
)  # fmt: skip
PENDING_ROWS = 1 << 21  # most samples that wait for the rest of their blocks, 70 MB


@dataclass(frozen=True, kw_only=True)
class ImportRecord:
    """Provenance of an import.

    ``phase_ns`` is the start of the samples modulo the step, counted from 1970. ``name``,
    ``sha256`` and ``size_bytes`` are those of the file, ``options`` those of reading, and ``notes``
    what was found and assumed; ``rows`` were read, ``samples`` have a reading.
    """

    grid: str
    nominal_hz: float
    step_ns: int
    phase_ns: int
    name: str
    sha256: str
    size_bytes: int
    options: dict[str, Any]
    imported_utc: str
    rsenf: str
    rows: int
    samples: int
    notes: tuple[str, ...]

    @property
    def raster(self) -> Raster:
        """The times at which samples begin, numbered from 1970."""
        return Raster(self.phase_ns, self.step_ns)

    @property
    def zone_unknown(self) -> bool:
        """Whether its times have no zone and none was given."""
        return NO_ZONE in self.notes

    def metadata(self) -> dict[str, str]:
        """Return it as Parquet metadata."""
        return {KEY: json.dumps({"version": VERSION, **asdict(self)})}


def record_in(metadata: dict[bytes, bytes] | None, path: Path) -> ImportRecord:
    """Read the record in the Parquet metadata of a file.

    Raises
    ------
    ReferenceFormatError
        If the file doesn't belong to the store.
    SchemaMismatch
        If it has another version.
    """
    text = (metadata or {}).get(KEY.encode())
    if text is None:
        raise ReferenceFormatError(f"{path} is not of the store", "remove it from there")
    with _legible(path):
        return _record(json.loads(text), path)


def _record(held: dict[str, Any], path: Path) -> ImportRecord:
    version = held.pop("version", None)
    if version != VERSION:
        raise SchemaMismatch(
            f"{path}: version {version} of the store's format, not {VERSION}",
            "written by another rsenf: use that one, or import the original again",
        )
    # Older files lack newer options, and the note on times taken as UTC.
    options, notes = asdict(ReadOptions()) | held["options"], tuple(held["notes"])
    if options["timezone"] is None and TAKEN_AS_UTC in notes and NO_ZONE not in notes:
        notes = (*notes, NO_ZONE)
    record = TypeAdapter(ImportRecord).validate_python(held | {"options": options, "notes": notes})
    if record.nominal_hz not in (50.0, 60.0) or record.step_ns < 1:
        raise ValueError(f"steps of {record.step_ns} ns about {record.nominal_hz:g} Hz")
    return record


class Group(NamedTuple):
    """A row group: ``rows`` samples of one block, from ``first`` to ``last``."""

    file: SampleFile
    number: int
    first: int
    last: int
    rows: int

    @property
    def means(self) -> range:
        """Numbers of the means of its samples; mean 0 is that of the samples from 0."""
        return range(self.first // MEAN_OF, self.last // MEAN_OF + 1)

    @property
    def has_means(self) -> bool:
        """Whether the file holds them."""
        return self.file.has_means and len(self.means) <= self.rows

    def read(self) -> Samples:
        """Read the samples: only the columns that the statistics don't determine."""
        with _legible(self.file.path):
            samples = self._samples()
            if not samples.index.size == samples.total.size == self.rows:
                raise ValueError(f"row group {self.number} has another number of samples")
            if samples.readings.min() < 1:
                raise ValueError(f"row group {self.number} has samples without a reading")
        return samples

    def _samples(self) -> Samples:
        raster, gaps = self.file.record.raster, self.last - self.first + 1 > self.rows
        statistics = self.file.metadata.row_group(self.number).column(_READINGS).statistics
        several = statistics.max > 1
        columns = ["sum_uhz", *["time"] * gaps, *_OF_SEVERAL * several]
        with self.file.open() as file:
            rows = file.read_row_group(self.number, columns, use_threads=False)
        index = np.arange(self.first, self.last + 1)
        if gaps:
            t_ns = rows["time"].to_numpy().astype(np.int64, copy=False)
            index = (t_ns - raster.t0_ns) // raster.step_ns
            if np.any(np.diff(index, prepend=self.first - 1, append=self.last + 1) < 1):
                raise ValueError(f"the times of row group {self.number} aren't in order")
        total = rows["sum_uhz"].to_numpy()
        if not several:
            once = np.broadcast_to(np.uint32(1), self.rows)
            return Samples(index, total, once, total, total, UNIT_HZ)
        # Least and largest readings are stored only if a sample has several.
        kept = (rows[name].to_numpy() for name in ("low_uhz", "high_uhz"))
        low, high = (np.where(np.isnan(v), total, v).astype(np.int64) for v in kept)
        return Samples(index, total, rows["readings"].to_numpy(), low, high, UNIT_HZ)

    def read_means(self) -> FloatArray:
        """Read the means, if the file holds them (units; NaN where there is none)."""
        count = len(self.means)
        with _legible(self.file.path), self.file.open() as file:
            # Only these rows are unpacked.
            batches = file.iter_batches(count, [self.number], [_MEAN], use_threads=False)
            batch = next(batches, None)
            if batch is None or batch.num_rows != count:
                raise ValueError(f"row group {self.number} has another number of means")
            return np.asarray(batch.column(0).to_numpy(zero_copy_only=False), np.float64)


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
            self.metadata = parquet.read_metadata(path)
            self.record = record_in(self.metadata.metadata, path)

    def open(self) -> Any:
        """Open the Parquet file, whose metadata are known."""
        from pyarrow import parquet

        return parquet.ParquetFile(self.path, metadata=self.metadata)

    @cached_property
    def groups(self) -> list[Group]:
        """All row groups."""
        with _legible(self.path):
            return [self._group(number) for number in range(self.metadata.num_row_groups)]

    def _group(self, number: int) -> Group:
        group, raster = self.metadata.row_group(number), self.record.raster
        for at in range(group.num_columns):
            # Arrow's statistics end the process where these differ.
            if group.column(at).physical_type != self.metadata.schema.column(at).physical_type:
                raise ValueError(f"row group {number} has another type in column {at}")
        times = group.column(0).statistics
        ends_ns = times.min_raw, times.max_raw
        first, last = ((t_ns - raster.t0_ns) // raster.step_ns for t_ns in ends_ns)
        if first // BLOCK != last // BLOCK or not 0 < group.num_rows <= last - first + 1:
            raise ValueError(f"row group {number} can't be of one block")
        return Group(self, number, first, last, group.num_rows)

    @property
    def span_ns(self) -> tuple[int, int]:
        """Start of the first and end of the last sample, UTC since 1970."""
        first = min(group.first for group in self.groups)
        last = max(group.last for group in self.groups)
        raster = self.record.raster
        return raster.time_ns(first), raster.time_ns(last + 1)

    @property
    def has_means(self) -> bool:
        """Whether an rsenf wrote it that knew of means."""
        return _MEAN in self.metadata.schema.names


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
            pa.field(_MEAN, pa.int32()),
        ]
    )


def means_of(samples: Samples, numbers: range) -> FloatArray:
    """Return means of ``MEAN_OF`` samples, in whole units; NaN where fewer than half are valid.

    Parameters
    ----------
    samples : Samples
        All of them in the means.
    numbers : range
        Of the means; mean 0 is that of the samples from 0.
    """
    freq, _ = samples.dense(numbers.start * MEAN_OF, len(numbers) * MEAN_OF)
    return np.rint(means(np.rint(freq), MEAN_OF))


@contextmanager
def _legible(path: Path) -> Iterator[None]:
    import pyarrow as pa

    try:
        yield
    except RsenfError:
        raise
    except (pa.ArrowException, *_NOT_OF_THE_STORE) as exc:
        reason = (str(exc).splitlines() or [type(exc).__name__])[0].rstrip(". ")
        raise ReferenceFormatError(
            f"{path} can't be read: {reason}", "remove it, and import its original again"
        ) from None


class SampleWriter:
    """An import being written.

    Parameters
    ----------
    path : Path
    raster : Raster
        The times at which samples begin, numbered from its ``t0_ns``.
    """

    def __init__(self, path: Path, raster: Raster) -> None:
        from pyarrow import parquet

        self._raster = raster
        self._pending: dict[int, list[Samples]] = {}
        self._pending_rows = self.samples = 0
        self.notes = Notes()
        # Delta encoding: consecutive times take no space, and neighbouring values are similar.
        self._writer = parquet.ParquetWriter(
            path,
            schema(),
            compression="zstd",
            use_dictionary=["readings"],
            column_encoding=dict.fromkeys(("time", "sum_uhz", _MEAN), "DELTA_BINARY_PACKED"),
        )

    def add(self, samples: Samples) -> None:
        """Add samples; write blocks when too many are pending."""
        if not len(samples):
            return
        blocks = samples.index // BLOCK
        starts = np.flatnonzero(np.diff(blocks, prepend=blocks[:1] - 1)).tolist()
        for a, b in zip(starts, [*starts[1:], len(samples)], strict=True):
            self._pending.setdefault(int(blocks[a]), []).append(samples.part(slice(a, b)))
        self._pending_rows += len(samples)
        if self._pending_rows > PENDING_ROWS:
            newest = int(blocks[-1])
            for block in [b for b in self._pending if b != newest]:
                self._write(block)

    def flush(self) -> None:
        """Write all pending blocks."""
        for block in list(self._pending):
            self._write(block)

    def finish(self, record: ImportRecord) -> None:
        """Write the record."""
        self._writer.add_key_value_metadata(record.metadata())

    def close(self) -> None:
        """Close the file, complete or not."""
        self._writer.close()

    def _write(self, block: int) -> None:
        import pyarrow as pa

        samples = merged(self._pending.pop(block))
        samples.note(self.notes)
        self._pending_rows = sum(len(p) for parts in self._pending.values() for p in parts)
        self.samples += len(samples)
        t_ns = self._raster.time_ns(samples.index)
        once = ~samples.repeated
        columns = [t_ns, samples.total, samples.readings]
        arrays = [pa.array(c, f.type) for c, f in zip(columns, schema(), strict=False)]
        arrays += [pa.array(c, pa.int32(), mask=once) for c in (samples.low, samples.high)]
        numbers = range(int(samples.index[0]) // MEAN_OF, int(samples.index[-1]) // MEAN_OF + 1)
        mean = np.full(len(samples), np.nan)
        if len(numbers) <= len(samples):
            mean[: len(numbers)] = means_of(samples, numbers)
        arrays.append(pa.array(mean, pa.int32(), from_pandas=True))
        self._writer.write_table(pa.table(arrays, schema()), row_group_size=BLOCK)
