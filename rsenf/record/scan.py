"""Reads a file record by record, skips damage, and determines what the file contains.

A recording consists mainly of chunks with checksums, besides their indexes and metadata. After
damage, reading resumes at the next chunk that passes its checksum, or the next metadata record of
rsenf, at any offset: the length in a damaged record can't be trusted.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, MessageIndex, Metadata, Schema
from mcap.records import Header as FileHeader

from rsenf.record.container import (
    HEAD,
    MAGIC,
    DamagedError,
    Record,
    unpack,
    unpack_chunk,
    unpack_message,
    walk,
)
from rsenf.record.index import Extent, Index, Times, index_chunk, timed

OURS = "rsenf "
_KINDS: dict[int, Any] = {
    Opcode.HEADER: FileHeader,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.MESSAGE_INDEX: MessageIndex,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}
_IN_CHUNKS = {int(Opcode.SCHEMA), int(Opcode.CHANNEL), int(Opcode.MESSAGE)}
# Record heads at which to resume: a chunk (length below 2^32, known compression), or metadata whose
# name begins with 'rsenf'.
_HEADS = re.compile(
    rb"\x06.{4}\0{4}.{28}(?:\x04\0{3}zstd|\x03\0{3}lz4|\0{4})|\x0c.{4}\0{4}.\0{3}rsenf", re.DOTALL
)
_WINDOW = 1 << 20
_LONGEST_HEAD = 64
# In a malicious file, every byte may look like a chunk. After checking this multiple of the file's
# size in vain, the rest is skipped.
_PATIENCE = 8


class IntactRecord(NamedTuple):
    """An intact record."""

    record: Record  # its position and bytes
    content: Any  # its parsed content; None for unused kinds
    parts: list[Record]  # records inside a chunk


class Damage(NamedTuple):
    """Bytes that aren't intact records."""

    start: int  # their position
    end: int
    why: str  # what is wrong with them
    breaks_off: bool  # whether they are only a record truncated by the end of the file


def intact_records(
    stream: BinaryIO, end: int, start: int = len(MAGIC)
) -> Iterator[IntactRecord | Damage]:
    """Yield all intact records up to ``end`` or the end of the data section, and all damage."""
    check, spent, size = _Check(), 0, end - start
    while start < end:
        why = ""
        for record in walk(stream, start, end):
            try:
                intact = check(record)
            except DamagedError as exc:
                why = str(exc)
                break
            yield intact
            start = record.end
            if record.opcode == Opcode.DATA_END:
                return
        if start < end:
            found, cost = _go_on(stream, start + 1, end, check, _PATIENCE * size - spent)
            spent += cost
            breaks_off = not why and found == end
            yield Damage(start, found, why or "bytes that are no whole record", breaks_off)
            start = found


class _Check:
    """Checks records. Files of other programs may lack checksums and contain other kinds."""

    def __init__(self) -> None:
        self._foreign = False

    def __call__(self, record: Record) -> IntactRecord:
        """Return the record with its content.

        Raises
        ------
        DamagedError
            When it is damaged.
        """
        kind = _KINDS.get(record.opcode)
        if kind is None:
            return self._of_others(record)
        content = unpack(kind, record.body)
        if record.opcode == Opcode.HEADER:
            if record.start != len(MAGIC):
                raise DamagedError("a Header record that isn't the first")
            self._foreign = not content.library.startswith(OURS)
        parts = self._parts(content) if record.opcode == Opcode.CHUNK else []
        return IntactRecord(record, content, parts)

    def _of_others(self, record: Record) -> IntactRecord:
        if not self._foreign or record.opcode == Opcode.FOOTER:
            raise DamagedError(f"a record of kind {record.opcode}, which has no place here")
        is_message = record.opcode == Opcode.MESSAGE
        return IntactRecord(record, unpack_message(record.body) if is_message else None, [])

    def _parts(self, chunk: Any) -> list[Record]:
        data = unpack_chunk(chunk, checked=not self._foreign)
        parts = list(walk(BytesIO(data), 0, len(data)))
        if (parts[-1].end if parts else 0) != len(data):
            raise DamagedError("a chunk that doesn't consist of records")
        if not self._foreign and not {part.opcode for part in parts} <= _IN_CHUNKS:
            raise DamagedError("a chunk with records that have no place in one")
        for part in parts:
            if part.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                unpack(_KINDS[part.opcode], part.body)  # may be invalid if there is no checksum
        return parts


def _go_on(stream: BinaryIO, start: int, end: int, check: _Check, patience: int) -> tuple[int, int]:
    """Return the offset of the next intact record, or the end, and the number of bytes checked."""
    spent = 0
    while (found := _next_head(stream, start, end)) is not None and spent <= patience:
        stream.seek(found)
        length = HEAD.unpack(stream.read(HEAD.size))[1]
        if found + HEAD.size + length <= end:
            spent += length
            for record in walk(stream, found, found + HEAD.size + length):
                try:
                    check(record)
                except DamagedError:
                    break
                return found, spent
        start = found + 1
    return end, spent


def _next_head(stream: BinaryIO, start: int, end: int) -> int | None:
    while start < end:
        stream.seek(start)
        window = stream.read(min(_WINDOW, end - start))
        match = _HEADS.search(window)
        if match:
            return start + match.start()
        if len(window) < _WINDOW:
            return None
        start += _WINDOW - _LONGEST_HEAD
    return None


Watch = Callable[[IntactRecord | Damage], None]


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
    summary_chunks: list[bytes] = field(default_factory=list)  # indexes in the summary section
    summary_messages: dict[str, int] | None = None  # counts there, by topic; None if unknown
    missing_indexes: bytes = b""  # message indexes of the last chunk, to be written at `end`
    last_chunk_start: int = len(MAGIC)

    @property
    def cut_bytes(self) -> int:
        """Bytes after the last intact record of a truncated file; 0 for other files."""
        return 0 if self.complete else self.limit - self.end

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
    for found in intact_records(stream, size):
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

    def take(self, found: IntactRecord) -> None:
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

    def _begin(self, found: IntactRecord) -> None:
        record, times = found.record, times_of(found.parts)
        chunk = timed(found.content, times)
        if chunk != found.content:
            why = "a chunk that says other times than its messages"
            self.contents.add_damage(record.start, record.end, why)
        for part in found.parts:
            define(self.contents.index, part)
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
        self.contents.index.add_chunk(entry, times)
