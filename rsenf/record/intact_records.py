"""Iterates over the intact records of a file, and reports and skips damage.

A recording consists mainly of chunks with checksums, besides their indexes and metadata. After
damage, reading resumes at the next chunk that passes its checksum, or the next metadata record of
rsenf, at any offset: the length in a damaged record can't be trusted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
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


class IntactRecords(NamedTuple):
    """An intact record.

    Attributes
    ----------
    record : Record
        Its position and bytes.
    content : a record class of the ``mcap`` library, StoredMessage or None
        Its parsed content; None for unused kinds.
    parts : list of Record
        Records inside a chunk.
    """

    record: Record
    content: Any
    parts: list[Record]


class Damage(NamedTuple):
    """Bytes that aren't intact records.

    Attributes
    ----------
    start, end : int
        Their position.
    why : str
        What is wrong with them.
    breaks_off : bool
        Whether they are only a record truncated by the end of the file.
    """

    start: int
    end: int
    why: str
    breaks_off: bool


def sound_records(
    stream: BinaryIO, end: int, start: int = len(MAGIC)
) -> Iterator[IntactRecords | Damage]:
    """Yield all intact records up to ``end`` or the end of the data section, and all damage."""
    check, spent, size = _Check(), 0, end - start
    while start < end:
        why = ""
        for record in walk(stream, start, end):
            try:
                sound = check(record)
            except DamagedError as exc:
                why = str(exc)
                break
            yield sound
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

    def __call__(self, record: Record) -> IntactRecords:
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
            self._take_header(record, content)
        parts = self._parts(content) if record.opcode == Opcode.CHUNK else []
        return IntactRecords(record, content, parts)

    def _take_header(self, record: Record, header: Any) -> None:
        if record.start != len(MAGIC):
            raise DamagedError("a Header record that isn't the first")
        self._foreign = not header.library.startswith(OURS)

    def _of_others(self, record: Record) -> IntactRecords:
        if not self._foreign or record.opcode == Opcode.FOOTER:
            raise DamagedError(f"a record of kind {record.opcode}, which has no place here")
        is_message = record.opcode == Opcode.MESSAGE
        return IntactRecords(record, unpack_message(record.body) if is_message else None, [])

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
