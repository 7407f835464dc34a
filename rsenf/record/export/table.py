"""Selects a run and epoch of a topic, and exports it as a table in CSV or Parquet.

Messages: one line each, with names and units of their schema.

Row blocks: one line for each frame with its exact time, and one column for each row and strip. This
wide format keeps the luma as a matrix, and doesn't repeat anything hundreds of times.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from rsenf.errors import InputError, UsageError
from rsenf.messages import Header, IdleEstimate, Mark, RowBlock, schema_name
from rsenf.messages.schema import FieldSpec, field_specs, message_classes
from rsenf.record.reader import Recording
from rsenf.whole_file import whole_file

_TYPES = {
    "int64": pa.int64(),
    "double": pa.float64(),
    "string": pa.string(),
    "bool": pa.bool_(),
    "float": pa.float32(),
    "sfixed64": pa.int64(),
    "fixed32": pa.uint32(),
}
# Columns before the fields of header and message. The schema includes its version.
_ABOUT = [("topic", pa.string()), ("schema", pa.string()), ("log_time_ns", pa.int64())]
# Fields of a block that are repeated for each of its frames.
_OF_BLOCK = ("read_out_axis", "steady_ratio", "clipped_ratio", "usable", "reason")
_LINES = 512  # batch size: a few MB for the widest tables


class MessageColumns:
    """Columns for messages of one class: all fields except bytes, including the header's.

    Lists stay lists. NaN, which means "unknown" in a message, becomes null.

    Parameters
    ----------
    topic : str
        Topic of the messages.
    cls : type
        Their class.
    """

    def __init__(self, topic: str, cls: type[Any]) -> None:
        self._topic = topic
        self._schema = f"{schema_name(cls)}/{cls.VERSION}"
        self._fields = [spec for spec in field_specs(cls) if spec.wire not in ("bytes", "Header")]
        described = [*field_specs(Header), *self._fields]
        self.schema = pa.schema([*_ABOUT, *((spec.name, _type(spec)) for spec in described)])

    def lines(self, message: Any, log_time_ns: int) -> list[dict[str, Any]]:
        """Return the line of a message, by column."""
        line = self.about(message.header, log_time_ns)
        line.update((spec.name, _value(getattr(message, spec.name))) for spec in self._fields)
        return [line]

    def about(self, header: Header, log_time_ns: int) -> dict[str, Any]:
        """Return the columns before a message's own fields."""
        about = {"topic": self._topic, "schema": self._schema, "log_time_ns": log_time_ns}
        return about | {spec.name: getattr(header, spec.name) for spec in field_specs(Header)}


def _type(spec: FieldSpec) -> Any:
    inner = message_classes().get(spec.wire)
    kind = _TYPES[spec.wire] if inner is None else pa.struct(
        [(s.name, _type(s)) for s in field_specs(inner)]
    )  # fmt: skip
    return kind if spec.kind == "scalar" else pa.list_(kind)


def _value(value: Any) -> Any:
    """Convert a value for Arrow."""
    if isinstance(value, float):
        return None if math.isnan(value) else value
    if isinstance(value, np.ndarray):
        return _value(tuple(value.ravel().tolist()))
    if isinstance(value, tuple):
        return [_value(one) for one in value]
    if hasattr(value, "VERSION"):
        return {spec.name: _value(getattr(value, spec.name)) for spec in field_specs(type(value))}
    return value


class FrameRows(MessageColumns):
    """Columns for the frames of row blocks, which must all have the shape of the first.

    Parameters
    ----------
    topic : str
        Topic of the blocks.
    first : RowBlock
        The first block.
    """

    def __init__(self, topic: str, first: RowBlock) -> None:
        super().__init__(topic, RowBlock)
        self._shape = first.rows, first.strips
        self._levels = [
            f"luma_levels_row{row:04d}_strip{strip}"
            for row in range(first.rows)
            for strip in range(first.strips)
        ]
        of_block = [self.schema.field(name) for name in _OF_BLOCK]
        blocks = self.schema.get_field_index("arrival_time_ns") + 1
        self.schema = pa.schema(
            [
                *[self.schema.field(k) for k in range(blocks)],
                *of_block,
                pa.field("frame_number", pa.int64()),
                pa.field("frame_pts_ns", pa.int64()),
                *(pa.field(name, pa.float32()) for name in self._levels),
            ]
        )

    def lines(self, message: RowBlock, log_time_ns: int) -> list[dict[str, Any]]:
        """Return a line for each frame of a block.

        Raises
        ------
        InputError
            When the block has other rows or strips than the first.
        """
        if (message.rows, message.strips) != self._shape:
            raise InputError(
                f"the rows change from {self._shape[0]} × {self._shape[1]} strips to "
                f"{message.rows} × {message.strips} at frame {message.header.frame_first}",
                "export one stretch by itself, with --run and --epoch",
            )
        about = self.about(message.header, log_time_ns)
        about |= {name: getattr(message, name) for name in _OF_BLOCK}
        levels = np.reshape(message.level, (message.frames, -1)).tolist()
        times = zip(message.frame_number.tolist(), message.frame_pts_ns.tolist(), strict=True)
        return [
            about
            | {"frame_number": number, "frame_pts_ns": pts_ns}
            | dict(zip(self._levels, level, strict=True))
            for (number, pts_ns), level in zip(times, levels, strict=True)
        ]


def write_table(recording: Recording, topic: str, out: Path, part: Selection | None = None) -> int:
    """Write a topic's messages to a table; unreadable ones are counted in ``recording.loss``.

    One line for each message, or for each frame of row blocks. Marks and pictures are omitted. In
    CSV a list becomes a cell of JSON.

    Parameters
    ----------
    recording : Recording
    topic : str
        One of its topics.
    out : Path
        ``.csv`` or ``.parquet``; replaced once the table is complete.
    part : Selection, optional
        Selects messages; all by default.

    Returns
    -------
    int
        Number of lines.

    Raises
    ------
    UsageError
        When the file's suffix or the topic is unknown.
    InputError
        When no message can be read, or the number of rows changes.
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
    columns = FrameRows(topic, message) if is_rows else MessageColumns(topic, type(message))
    about = {"rsenf.recording": recording.path.name, "rsenf.topic": topic}
    lines, schema = 0, columns.schema.with_metadata(about)
    with whole_file(out) as file, writer(file, schema) as table:
        for batch in _batches(columns, itertools.chain([first], read)):
            table.write(pa.RecordBatch.from_pylist(batch, schema))
            lines += len(batch)
    return lines


def _batches(columns: MessageColumns, messages: Iterable[Any]) -> Iterator[list[dict[str, Any]]]:
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


IDLE = "/idle"


class RecordedLight:
    """Row blocks of one epoch of one run, with the recorded estimate of the idle ratio.

    Parameters
    ----------
    recording : Recording
    topic : str
        Topic of the row blocks.
    part : Selection
        Must select one epoch of one run, since times don't continue from one to the next.

    Raises
    ------
    UsageError
        When the topic has no row blocks, or several epochs are selected.
    InputError
        When no rows can be read.
    """

    def __init__(self, recording: Recording, topic: str, part: Selection) -> None:
        if recording.topics[topic].schema != "rsenf.RowBlock":
            raise UsageError(f"{topic} is no light that could be heard", "a sound is made of rows")
        self._recording, self._topic = recording, topic
        found = dict.fromkeys(Selection(b.header.run_id, b.header.epoch) for b in self._all(part))
        if len(found) > 1:
            there = ", ".join(f"epoch {one.epoch} of run {one.run!r}" for one in found)
            raise UsageError(
                f"{recording.path}: the source restarted: {there}", "choose with --run, --epoch"
            )
        if not found:
            raise InputError(f"{recording.path}: no rows of {topic} that could be heard")
        self.part = next(iter(found))

    def blocks(self) -> Iterator[RowBlock]:
        """Read the row blocks; unreadable ones are skipped."""
        return self._all(self.part)

    @property
    def idle_ratio(self) -> float:
        """Recorded idle ratio; 0 for means of whole frames, which have no rows.

        Raises
        ------
        UsageError
            When the recording has no estimate.
        """
        if next(self.blocks()).read_out_axis == "frame":
            return 0.0
        if self._idle is None:
            raise UsageError(
                f"{self._recording.path}: the camera's idle period isn't in it, so the pitch "
                "of a sound can't be right",
                "give it with --idle-ratio; 'rsenf idle' finds it",
            )
        return self._idle.idle_ratio

    @property
    def upwards(self) -> bool:
        """Whether the recording says that the last row is read first."""
        return self._idle is not None and self._idle.direction == "reverse"

    @cached_property
    def _idle(self) -> IdleEstimate | None:
        topic = self._topic.rpartition("/")[0] + IDLE
        if topic not in self._recording.topics:
            return None
        latest = None
        for _, message, _ in self._recording.messages([topic], tolerant=True):
            if self.part.has(message.header) and message.verdict == "estimated":
                latest = message
        return latest

    def _all(self, part: Selection) -> Iterator[RowBlock]:
        for _, message, _ in self._recording.messages([self._topic], tolerant=True):
            if message.header.mark == Mark.DATA and message.frames and part.has(message.header):
                yield message


class Selection(NamedTuple):
    """Selection of a topic's messages; None selects all."""

    run: str | None = None  # identity of the run, or a prefix of it
    epoch: int | None = None

    def has(self, header: Header) -> bool:
        """Whether a message with this header is selected.

        Examples
        --------
        >>> Selection("ab").has(Header(run_id="abc")), Selection("ab", 2).has(Header(run_id="abc"))
        (True, False)
        """
        return header.run_id.startswith(self.run or "") and self.epoch in (None, header.epoch)
