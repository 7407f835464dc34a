"""Determines the contents of a file by reading all of it; only damaged records are lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from rsenf.record.chunk import Extent, Times, extents_of, index_chunk, timed
from rsenf.record.container import MAGIC, Record, unpack, unpack_message
from rsenf.record.index import Index
from rsenf.record.intact_records import Damage, IntactRecords, sound_records

Watch = Callable[[IntactRecords | Damage], None]


@dataclass
class Contents:
    """Contents of a file, and the position up to which it is readable."""

    index: Index = field(default_factory=Index)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    complete: bool = False  # whether the file has its end
    end: int = len(MAGIC)  # end of the last intact record of the data section
    limit: int = len(MAGIC)  # upper bound for the end of the data section
    damages: list[Damage] = field(default_factory=list)
    library: str = ""  # library that made the file
    chunks_said: list[bytes] = field(default_factory=list)  # chunk indexes in the summary section
    messages_said: dict[str, int] | None = None  # counts in it, by topic; None if unknown
    missing_indexes: bytes = b""  # message indexes of the last chunk, to be written at `end`
    last_chunk_start: int = len(MAGIC)

    def add_metadata(self, found: Any, start: int, end: int) -> None:
        """Add a metadata record; records of the same name are merged."""
        self.metadata.setdefault(found.name, {}).update(found.metadata)
        self.index.add_metadata(found.name, start, end - start)

    def add_definitions(self, defined: Index) -> None:
        """Add schemas and channels that the remaining chunks don't define."""
        self.index.schemas = {**defined.schemas, **self.index.schemas}
        self.index.channels = {**defined.channels, **self.index.channels}

    def add_damage(self, start: int, end: int, why: str) -> None:
        """Add a damaged range of bytes."""
        self.damages.append(Damage(start, end, why, breaks_off=False))


def define(index: Index, record: Record) -> None:
    """Add a schema or a channel to the index; other records are ignored."""
    if record.opcode == Opcode.SCHEMA:
        schema = unpack(Schema, record.body)
        index.schemas[schema.id] = schema
    elif record.opcode == Opcode.CHANNEL:
        channel = unpack(Channel, record.body)
        index.channels[channel.id] = channel


def times_of(parts: list[Record]) -> Times:
    """Return log time and offset of each message in a chunk's records, by channel."""
    times: Times = {}
    for part in parts:
        if part.opcode == Opcode.MESSAGE:
            message = unpack_message(part.body)
            times.setdefault(message.channel_id, []).append((message.log_time_ns, part.start))
    return times


def scan(stream: BinaryIO, size: int, watch: Watch | None = None) -> Contents:
    """Read all records of a file's first ``size`` bytes; ``watch`` gets each, and all damage."""
    scanner = _Scanner(size)
    for found in sound_records(stream, size):
        if watch is not None:
            watch(found)
        if isinstance(found, Damage):
            scanner.contents.damages.append(found)
        elif found.record.opcode != Opcode.DATA_END:
            scanner.take(found)
    scanner.settle(last=True)
    return scanner.contents


class _Scanner:
    """Collects the contents from the records of a data section."""

    def __init__(self, size: int) -> None:
        self.contents = Contents(limit=size)
        self._chunk: tuple[Any, int, int, Times] | None = None
        self._offsets: dict[int, int] = {}
        self._indexes_end = 0

    def take(self, found: IntactRecords) -> None:
        record, content = found.record, found.content
        self.contents.end = record.end
        if record.opcode == Opcode.MESSAGE_INDEX:
            self._take_index(record, content)
            return
        self.settle()
        if record.opcode == Opcode.CHUNK:
            self._begin(found)
        elif record.opcode == Opcode.MESSAGE:
            time = content.log_time_ns
            self.contents.index.add_extents({content.channel_id: Extent(1, time, time)})
        elif record.opcode == Opcode.METADATA:
            self.contents.add_metadata(content, record.start, record.end)
        elif record.opcode == Opcode.HEADER:
            self.contents.library = content.library
        else:
            define(self.contents.index, record)

    def _take_index(self, record: Record, found: Any) -> None:
        times = self._chunk[3] if self._chunk else {}
        if sorted(found.records) == sorted(times.get(found.channel_id, [])):
            self._offsets[found.channel_id] = record.start
            self._indexes_end = record.end
        else:
            why = "an index that doesn't fit its chunk"
            self.contents.add_damage(record.start, record.end, why)

    def _begin(self, found: IntactRecords) -> None:
        record, times = found.record, times_of(found.parts)
        chunk = timed(found.content, times)
        if chunk != found.content:
            why = "a chunk that says other times than its messages"
            self.contents.add_damage(record.start, record.end, why)
        for part in found.parts:
            define(self.contents.index, part)
        self.contents.index.add_extents(extents_of(times))
        self._chunk = (chunk, record.start, record.end, times)
        self._offsets, self._indexes_end = {}, record.end
        self.contents.last_chunk_start = record.start

    def settle(self, last: bool = False) -> None:
        """Add the last chunk to the index, after its message indexes."""
        if self._chunk is None:
            return
        chunk, start, end, times = self._chunk
        self._chunk = None
        entry, message_indexes = index_chunk(chunk, start, end - start, times)
        if set(self._offsets) >= set(times):
            entry.message_index_offsets = self._offsets
            entry.message_index_length = self._indexes_end - end
        elif last:
            self.contents.end, self.contents.missing_indexes = end, message_indexes
        else:
            entry.message_index_offsets, entry.message_index_length = {}, 0
        self.contents.index.add_chunk(entry)
