"""A topic as a table: CSV, or Parquet."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from rsenf.errors import InputError, UsageError
from rsenf.messages import Mark, RowBlock
from rsenf.record.export.columns import Columns
from rsenf.record.export.frame_rows import FrameRows
from rsenf.record.export.part import Part
from rsenf.record.reader import Recording
from rsenf.whole_file import whole_file

_LINES = 512  # written at once: a few MB of the widest tables


def write_table(recording: Recording, topic: str, out: Path, part: Part | None = None) -> int:
    """Write a topic's messages to a table, what can't be read left out and counted in its loss.

    One line a message, or a frame for row blocks. Marks and pictures are left out. In CSV a list
    is a cell of JSON.

    Parameters
    ----------
    recording : Recording
        The recording.
    topic : str
        One of its topics.
    out : Path
        ``.csv`` or ``.parquet``; replaced once the table is complete.
    part : Part, optional
        Which of them; all unless given.

    Returns
    -------
    int
        Lines.

    Raises
    ------
    UsageError
        When the name is of neither kind, or there is no such topic.
    InputError
        When no message can be read, or rows change their number.
    RecordingError
        When the table can't be written.
    """
    writer = _WRITERS.get(out.suffix.lower())
    if writer is None:
        raise UsageError(f"{out}: not a kind of table", f"one of {', '.join(_WRITERS)}")
    read = (
        (message, log_time_ns)
        for _, message, log_time_ns in recording.messages([topic], tolerant=True)
        if message.header.mark == Mark.DATA and (part is None or part.has(message.header))
    )
    first = next(read, None)
    if first is None:
        raise InputError(f"{recording.path}: nothing of {topic} can be read", "look at its topics")
    message = first[0]
    is_rows = isinstance(message, RowBlock)
    columns = FrameRows(topic, message) if is_rows else Columns(topic, type(message))
    about = {"rsenf.recording": recording.path.name, "rsenf.topic": topic}
    lines, schema = 0, columns.schema.with_metadata(about)
    with whole_file(out) as file, writer(file, schema) as table:
        for batch in _batches(columns, _all(first, read)):
            table.write(pa.RecordBatch.from_pylist(batch, schema))
            lines += len(batch)
    return lines


def _all(first: Any, rest: Iterable[Any]) -> Iterator[Any]:
    yield first
    yield from rest


def _batches(columns: Columns, messages: Iterable[Any]) -> Iterator[list[dict[str, Any]]]:
    batch: list[dict[str, Any]] = []
    for message, log_time_ns in messages:
        batch += columns.lines(message, log_time_ns)
        if len(batch) >= _LINES:
            yield batch
            batch = []
    if batch:
        yield batch


class _Csv:
    """Writes batches as CSV, lists as JSON."""

    def __init__(self, path: Path, schema: Any) -> None:
        self._lists = [f.name for f in schema if pa.types.is_list(f.type)]
        fields = [pa.field(f.name, pa.string()) if f.name in self._lists else f for f in schema]
        self._schema = pa.schema(fields)
        self._writer = pyarrow.csv.CSVWriter(path, self._schema)

    def __enter__(self) -> _Csv:
        return self

    def __exit__(self, *error: object) -> None:
        self._writer.close()

    def write(self, batch: Any) -> None:
        for name in self._lists:
            cells = [json.dumps(value) for value in batch.column(name).to_pylist()]
            at = batch.schema.get_field_index(name)
            batch = batch.set_column(at, pa.field(name, pa.string()), pa.array(cells, pa.string()))
        self._writer.write(batch.cast(self._schema))


_WRITERS: dict[str, Callable[[Path, Any], AbstractContextManager[Any]]] = {
    ".csv": _Csv,
    ".parquet": pyarrow.parquet.ParquetWriter,
}
