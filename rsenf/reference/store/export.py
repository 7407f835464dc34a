"""Exports a series of the store as a file that reads back to the same values."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rsenf.errors import UsageError
from rsenf.reference.store.sample_file import BLOCK
from rsenf.reference.store.stored import StoredReference
from rsenf.timebase import nanoseconds
from rsenf.whole_file import whole_file

if TYPE_CHECKING:
    import pyarrow as pa

ENDINGS = (".csv", ".parquet")


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
    if path.suffix.lower() not in ENDINGS:
        raise UsageError(f"{path}: neither {' nor '.join(ENDINGS)}", "name the file so")
    schema = _schema(reference)
    written = 0
    with whole_file(path) as part, closing(_writer(part, schema)) as writer:
        for t_ns, freq_hz in _values(reference):
            writer.write_table(_table(t_ns, freq_hz, schema))
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


def _table(t_ns: Any, freq_hz: Any, schema: pa.Schema) -> pa.Table:
    import pyarrow as pa

    times = pa.array(t_ns, pa.timestamp("ns", "UTC")).cast(schema.field(0).type)
    return pa.table([times, pa.array(freq_hz)], schema)


def _writer(path: Path, schema: pa.Schema) -> Any:
    from pyarrow import csv, parquet

    if path.suffix.lower() == ".csv":
        return csv.CSVWriter(path, schema)
    # Parquet has no unit of seconds; it stores them as milliseconds.
    return parquet.ParquetWriter(path, schema, compression="zstd")
