"""Writes an import, piece by piece, in bounded memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rsenf.reference.axis import Raster
from rsenf.reference.notes import Notes
from rsenf.reference.samples import Samples, merged
from rsenf.reference.store.record import Record
from rsenf.reference.store.sample_file import BLOCK, schema

PENDING_ROWS = 1 << 21  # most samples that wait for the rest of their blocks, 70 MB


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
            column_encoding={"time": "DELTA_BINARY_PACKED", "sum_uhz": "DELTA_BINARY_PACKED"},
        )

    def add(self, samples: Samples) -> None:
        """Add samples; write blocks when too many are pending."""
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

    def finish(self, record: Record) -> None:
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
        self._writer.write_table(pa.table(arrays, schema()), row_group_size=BLOCK)
