"""Reads the columns of a plain Parquet file, as other programs write it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.errors import ReferenceFormatError
from rsenf.reference.columns import Columns, find_columns

if TYPE_CHECKING:
    import pyarrow as pa

BATCH_ROWS = 1 << 18


def parquet_columns(
    path: Path, column: str | None, time_column: str | None = None
) -> Iterator[Columns]:
    """Yield the frequency and the time column, some rows at a time.

    A time column is found by its name, or as the only column of Arrow time stamps.

    Raises
    ------
    ReferenceFormatError
        If it is no Parquet file, or there is no such column.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        with parquet.ParquetFile(path) as file:
            fields = list(file.schema_arrow)
            frequency, time = _find(fields, path.name, column, time_column)
            wanted = [f.name for f in (frequency, time) if f is not None]
            for batch in file.iter_batches(BATCH_ROWS, columns=wanted, use_threads=False):
                batch.validate(full=True)
                if batch.num_rows:
                    times = None if time is None else batch.column(time.name)
                    time_name = "" if time is None else time.name
                    yield Columns(batch.column(frequency.name), times, frequency.name, time_name)
    except (pa.ArrowException, OSError, UnicodeDecodeError) as exc:
        reason = str(exc).splitlines()[0].rstrip(". ")
        raise ReferenceFormatError(
            f"{path.name} is no Parquet file that can be read: {reason}", "fetch or copy it again"
        ) from None


def _find(
    fields: list[pa.Field], where: str, column: str | None, time_column: str | None
) -> tuple[pa.Field, pa.Field | None]:
    import pyarrow as pa

    names = [f.name for f in fields]
    frequency, time, _ = find_columns(names, where, column, time_column)
    kind = fields[frequency].type
    if not _is_readable(kind):
        raise ReferenceFormatError(
            f"{where}: column {fields[frequency].name!r} holds {kind}, no numbers",
            "is it the right column? See --column",
        )
    if time is not None:
        return fields[frequency], fields[time]
    stamps = [f for f in fields if pa.types.is_timestamp(f.type)]
    return fields[frequency], stamps[0] if len(stamps) == 1 else None


def _is_readable(kind: Any) -> bool:
    import pyarrow as pa

    tests = (
        pa.types.is_floating,
        pa.types.is_integer,
        pa.types.is_decimal,
        pa.types.is_string,
        pa.types.is_large_string,
    )
    return any(test(kind) for test in tests)
