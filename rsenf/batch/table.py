"""The result table as Parquet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from rsenf.batch.columns import VERSION, Row, columns_of
from rsenf.timebase import utc_text
from rsenf.whole_file import whole_file

_TYPES = {
    "text": pa.string(),
    "texts": pa.list_(pa.string()),
    "number": pa.float64(),
    "count": pa.int64(),
}


def table_rows(analysis: str, rows: Sequence[Row]) -> list[Row]:
    """Return rows of the journal with the table's columns, and texts that any program can read."""
    return [{name: _cell(name, row) for name in columns_of(analysis)} for row in rows]


def write_parquet(path: Path, analysis: str, rows: Sequence[Row], about: dict[str, str]) -> None:
    """Write a table, all of it or nothing.

    Parameters
    ----------
    path : Path
    analysis : str
    rows : sequence of dict
        As :func:`table_rows` returns them.
    about : dict of str
        Kept beside the table's version, under ``rsenf.…``.

    Raises
    ------
    RecordingError
        When it can't be written.
    """
    notes = {"batch_version": str(VERSION), "analysis": analysis, **about}
    schema = pa.schema(
        [(name, _TYPES[kind]) for name, kind in columns_of(analysis).items()],
        {f"rsenf.{name}": value for name, value in notes.items()},
    )
    with whole_file(path) as part:
        pyarrow.parquet.write_table(pa.Table.from_pylist(list(rows), schema), part)


def _cell(name: str, row: Row) -> Any:
    if name == "modified_utc":
        return utc_text(row["modified_ns"]) if row["modified_ns"] >= 0 else None
    value = row.get(name)
    if isinstance(value, list):
        return [_text(line) for line in value]
    return _text(value) if isinstance(value, str) else value


def _text(value: str) -> str:
    """Show bytes of a name that aren't UTF-8 as they are written elsewhere."""
    return value.encode("utf-8", "backslashreplace").decode("utf-8")
