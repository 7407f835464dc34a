"""What is in a file, found from its summary where that is sound, and by reading it otherwise."""

from __future__ import annotations

import zlib
from io import BytesIO
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, MessageIndex, MetadataIndex, Statistics

from rsenf.record.chunk import Extent, Times, extents_of
from rsenf.record.container import HEAD, MAGIC, DamagedError, Record, unpack, walk
from rsenf.record.scan import Contents, define, scan

FOOTER_BYTES = HEAD.size + 20


def read_contents(stream: BinaryIO, size: int) -> Contents:
    """Find out what a file of ``size`` bytes holds."""
    footer = _footer(stream, size)
    if footer is not None and footer.summary_start:
        try:
            return _from_summary(stream, size, footer)
        except DamagedError:
            pass  # reading it all finds what the summary should have said
    contents = scan(stream, size)
    contents.complete = footer is not None
    return contents


def _footer(stream: BinaryIO, size: int) -> Any:
    start = size - len(MAGIC) - FOOTER_BYTES
    if start < len(MAGIC):
        return None
    stream.seek(size - len(MAGIC))
    if stream.read(len(MAGIC)) != MAGIC:
        return None
    record = next(walk(stream, start, size - len(MAGIC)), None)
    if record is None or record.opcode != Opcode.FOOTER or record.end != size - len(MAGIC):
        return None
    return unpack(Footer, record.body)


def _from_summary(stream: BinaryIO, size: int, footer: Any) -> Contents:
    start, end = footer.summary_start, size - len(MAGIC) - FOOTER_BYTES
    if not len(MAGIC) <= start <= end:
        raise DamagedError("a summary that lies elsewhere")
    stream.seek(start)
    summary = stream.read(end + FOOTER_BYTES - 4 - start)
    if footer.summary_crc and zlib.crc32(summary) != footer.summary_crc:
        raise DamagedError("a summary that fails its checksum")
    contents = Contents(complete=True, end=size)
    counted = -1
    for record in walk(BytesIO(summary), 0, end - start):
        if record.opcode == Opcode.CHUNK_INDEX:
            contents.index.add_extents(
                _chunk_extents(stream, size, unpack(ChunkIndex, record.body))
            )
        elif record.opcode == Opcode.METADATA_INDEX:
            found = unpack(MetadataIndex, record.body)
            for metadata in _records_at(stream, size, found.offset, found.length):
                contents.add_metadata(metadata.body, metadata.start, metadata.end)
        elif record.opcode == Opcode.STATISTICS:
            counted = unpack(Statistics, record.body).message_count
        else:
            define(contents.index, record)
    if counted != contents.index.messages:
        raise DamagedError("a summary that doesn't index all messages")
    return contents


def _records_at(stream: BinaryIO, size: int, start: int, length: int) -> list[Record]:
    if start + length > size:
        raise DamagedError("an index that points outside the file")
    return list(walk(stream, start, start + length))


def _chunk_extents(stream: BinaryIO, size: int, entry: Any) -> dict[int, Extent]:
    start = entry.chunk_start_offset + entry.chunk_length
    times: Times = {}
    for record in _records_at(stream, size, start, entry.message_index_length):
        found = unpack(MessageIndex, record.body)
        if found.records:
            times[found.channel_id] = found.records
    return extents_of(times)
