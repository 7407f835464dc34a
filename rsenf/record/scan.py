"""What is in a file, found by reading all of it, as far as it goes."""

from __future__ import annotations

from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, MessageIndex, Metadata, Schema

from rsenf.record.chunk import Extent, Times, extents_of, index_chunk
from rsenf.record.container import (
    MAGIC,
    DamagedError,
    Record,
    unpack,
    unpack_chunk,
    unpack_message,
    walk,
)
from rsenf.record.index import Index


@dataclass
class Contents:
    """What a file holds, and where it stops making sense."""

    index: Index = field(default_factory=Index)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    complete: bool = False  # whether the file has its end
    end: int = len(MAGIC)  # end of the last sound record of the data section
    damaged: int = 0  # records that are whole but not what they should be
    missing_indexes: bytes = b""  # message indexes to write at `end`, the last chunk's own
    last_chunk_start: int = len(MAGIC)

    def add_metadata(self, body: bytes, start: int, end: int) -> None:
        """Take a metadata record; a later one of the same name adds to the earlier."""
        found = unpack(Metadata, body)
        self.metadata.setdefault(found.name, {}).update(found.metadata)
        self.index.add_metadata(found.name, start, end - start)


def define(index: Index, record: Record) -> None:
    """Note a schema or a channel; any other record is none of the index's business."""
    if record.opcode == Opcode.SCHEMA:
        schema = unpack(Schema, record.body)
        index.schemas[schema.id] = schema
    elif record.opcode == Opcode.CHANNEL:
        channel = unpack(Channel, record.body)
        index.channels[channel.id] = channel


def scan(stream: BinaryIO, size: int) -> Contents:
    """Read all records of a file, as far as it goes."""
    scanner = _Scanner()
    for record in walk(stream, len(MAGIC), size):
        if record.opcode in (Opcode.DATA_END, Opcode.FOOTER):
            break
        try:
            scanner.take(record)
        except DamagedError:
            scanner.contents.damaged += 1
        else:
            scanner.contents.end = record.end
    scanner.settle(last=True)
    return scanner.contents


class _Scanner:
    """Takes the records of a data section one by one."""

    def __init__(self) -> None:
        self.contents = Contents()
        self._chunk: tuple[Any, int, int, Times] | None = None
        self._offsets: dict[int, int] = {}
        self._indexes_end = 0

    def take(self, record: Record) -> None:
        index = self.contents.index
        if record.opcode == Opcode.MESSAGE_INDEX and self._chunk is not None:
            self._offsets[unpack(MessageIndex, record.body).channel_id] = record.start
            self._indexes_end = record.end
            return
        self.settle()
        if record.opcode == Opcode.CHUNK:
            self._begin(record)
        elif record.opcode == Opcode.MESSAGE:
            message = unpack_message(record.body)
            time = message.log_time_ns
            index.add_extents({message.channel_id: Extent(1, time, time)})
        elif record.opcode == Opcode.METADATA:
            self.contents.add_metadata(record.body, record.start, record.end)
        else:
            define(index, record)

    def _begin(self, record: Record) -> None:
        data = unpack_chunk(record.body)
        times: Times = {}
        for inner in walk(BytesIO(data), 0, len(data)):
            if inner.opcode == Opcode.MESSAGE:
                message = unpack_message(inner.body)
                times.setdefault(message.channel_id, []).append((message.log_time_ns, inner.start))
            else:
                define(self.contents.index, inner)
        self.contents.index.add_extents(extents_of(times))
        self._chunk = (unpack(Chunk, record.body), record.start, record.end, times)
        self._offsets, self._indexes_end = {}, record.end
        self.contents.last_chunk_start = record.start

    def settle(self, last: bool = False) -> None:
        """Note the chunk whose message indexes end here."""
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
