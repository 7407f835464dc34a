"""Determines the contents of a file from its summary section if valid, or else by a scan."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, BinaryIO

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, Metadata, MetadataIndex, Statistics

from rsenf.record.container import HEAD, MAGIC, DamagedError, Record, unpack, unpack_times, walk
from rsenf.record.index import DATA_END, Extent, Index, Times, extents_of, span_of
from rsenf.record.scan import OURS, Contents, Watch, define, scan
from rsenf.record.topics import topics_of

FOOTER_BYTES = HEAD.size + 20


@dataclass
class Summary:
    """Contents of a summary section; empty if it has no checksum."""

    defined: Index = field(default_factory=Index)  # schemas and channels
    chunks: list[bytes] = field(default_factory=list)  # contents of chunk index records
    metadata: list[Any] = field(default_factory=list)
    counts: dict[int, int] | None = None  # messages by channel

    @property
    def messages(self) -> int:
        """Number of messages of all channels; -1 if unknown."""
        return -1 if self.counts is None else sum(self.counts.values())

    @property
    def topics(self) -> dict[str, int] | None:
        """Number of messages of each topic with a defined channel; None if unknown."""
        if self.counts is None:
            return None
        counted = Index(schemas=self.defined.schemas, channels=self.defined.channels)
        counted.add_extents({channel: Extent(n, 0, 0) for channel, n in self.counts.items()})
        return {name: topic.messages for name, topic in topics_of(counted).items()}


def read_contents(stream: BinaryIO, size: int, watch: Watch | None = None) -> Contents:
    """Determine the contents of a file.

    Parameters
    ----------
    stream : binary file
    size : int
        Its size in bytes.
    watch : callable, optional
        Gets each intact record and all damage of the data section. If given, the file is read
        completely, even with a valid summary section.
    """
    footer = _footer(stream, size)
    if footer is None:
        contents = scan(stream, size, watch)
        # A truncated record is already implied by `complete`.
        contents.damages = [damage for damage in contents.damages if not damage.breaks_off]
        return contents
    summary, why = Summary(), ""
    try:
        summary = _summary(stream, size, footer)
        followed = _followed(stream, footer.summary_start, summary)
        if followed is not None and watch is None:
            return followed
    except DamagedError as exc:
        why = str(exc)
    contents = scan(stream, size - len(MAGIC) - FOOTER_BYTES, watch)
    contents.complete = True
    why = why or _fault(footer, summary, contents)
    # If chunks are damaged, a summary that differs from them is no further fault.
    if why and not contents.damages:
        contents.add_damage(contents.end, size, why)
    contents.add_definitions(summary.defined)
    contents.summary_chunks, contents.summary_messages = summary.chunks, summary.topics
    return contents


def _fault(footer: Any, summary: Summary, contents: Contents) -> str:
    """Return what is wrong with a readable or absent summary section; empty for nothing."""
    if not footer.summary_start:  # it is optional
        at_once = contents.limit - contents.end == len(DATA_END)
        return "" if at_once else "a footer that points to no summary"
    if not footer.summary_crc:
        return "a summary without a checksum" if contents.library.startswith(OURS) else ""
    there = [packed[HEAD.size :] for packed in contents.index.chunks]
    same = sorted(map(_place, summary.chunks)) == sorted(map(_place, there))
    return "" if same else "a summary that doesn't fit the chunks"


def _place(chunk_index: bytes) -> tuple[int, int]:
    entry = unpack(ChunkIndex, chunk_index)
    return entry.chunk_start_offset, entry.chunk_length


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


def _summary(stream: BinaryIO, size: int, footer: Any) -> Summary:
    start, end = footer.summary_start, size - len(MAGIC) - FOOTER_BYTES
    summary = Summary()
    if not start or not footer.summary_crc:
        return summary
    if not len(MAGIC) <= start <= end:
        raise DamagedError("a summary that lies elsewhere")
    stream.seek(start)
    content = stream.read(end + FOOTER_BYTES - 4 - start)
    if zlib.crc32(content) != footer.summary_crc:
        raise DamagedError("a summary that fails its checksum")
    for record in walk(BytesIO(content), 0, end - start):
        if record.opcode == Opcode.CHUNK_INDEX:
            summary.chunks.append(record.body)
        elif record.opcode == Opcode.METADATA_INDEX:
            summary.metadata.append(unpack(MetadataIndex, record.body))
        elif record.opcode == Opcode.STATISTICS:
            summary.counts = unpack(Statistics, record.body).channel_message_counts
        else:
            define(summary.defined, record)
    return summary


def _followed(stream: BinaryIO, limit: int, summary: Summary) -> Contents | None:
    """Return the contents that a summary section at ``limit`` points to.

    None if it doesn't point to all messages, which the format allows.
    """
    contents = Contents(complete=True, end=limit, limit=limit)
    contents.add_definitions(summary.defined)
    for body in summary.chunks:
        entry = unpack(ChunkIndex, body)
        contents.index.add_extents(_chunk_extents(stream, limit, entry))
    for entry in summary.metadata:
        for record in _records_at(stream, limit, entry.offset, entry.length):
            found = unpack(Metadata, record.body)
            if found.name != entry.name:
                raise DamagedError("a summary that names other metadata")
            contents.add_metadata(found, record.start, record.end)
    return contents if contents.index.messages == summary.messages else None


def _records_at(stream: BinaryIO, limit: int, start: int, length: int) -> Iterator[Record]:
    if start + length > limit:
        raise DamagedError("an index that points outside the data")
    return walk(stream, start, start + length)


def _chunk_extents(stream: BinaryIO, limit: int, entry: Any) -> dict[int, Extent]:
    start = entry.chunk_start_offset + entry.chunk_length
    times: Times = {}
    for record in _records_at(stream, limit, start, entry.message_index_length):
        channel, entries = unpack_times(record.body)
        if entries:
            times[channel] = entries
    extents = extents_of(times)
    span = span_of(extents.values())
    if span and span != (entry.message_start_time, entry.message_end_time):
        raise DamagedError("an index of other times than the summary's")
    return extents
