"""Chunks of a file, their index, and the MCAP summary section, which spares readers a scan.

A chunk holds compressed records, followed by an index of its messages. The index of a file counts
the messages of each channel, and keeps the times at which there are any, in bounded memory.
"""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from operator import itemgetter
from statistics import median
from typing import Any, NamedTuple

import zstandard
from mcap.opcode import Opcode
from mcap.records import (
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    MessageIndex,
    MetadataIndex,
    Statistics,
    SummaryOffset,
)

from rsenf.record.container import MAGIC, StoredMessage, chunk_head, pack, pack_message

ZSTD_LEVEL = 1  # higher levels don't compress noise any better, and take several times as long

# Log time (ns) and offset in the uncompressed chunk of each message, by channel.
Times = dict[int, list[tuple[int, int]]]
DATA_END = pack(DataEnd(0))
# A valid end without a summary section, for a full disk.
BARE_TAIL = DATA_END + pack(Footer(0, 0, 0)) + MAGIC
KEPT = 4096
SHORTEST_HOLE_NS = 500_000_000
DENSE = 4  # messages per stretch from which the usual interval is taken within stretches


class Extent(NamedTuple):
    """Number of messages of a channel, range of their log times, and largest step back of these."""

    messages: int
    first_ns: int
    last_ns: int
    back_ns: int = 0

    def joined(self, earlier: Extent | None) -> Extent:
        """Return the extent of an earlier part and this one together."""
        if earlier is None:
            return self
        return Extent(
            self.messages + earlier.messages,
            min(self.first_ns, earlier.first_ns),
            max(self.last_ns, earlier.last_ns),
            max(self.back_ns, earlier.back_ns, earlier.last_ns - self.first_ns),
        )


def extents_of(times: Times) -> dict[int, Extent]:
    """Return the extent of each channel in a chunk."""
    return {n: _extent(entries) for n, entries in times.items()}


def _extent(entries: list[tuple[int, int]]) -> Extent:
    written = [time_ns for time_ns, _ in sorted(entries, key=itemgetter(1))]
    ordered = sorted(written)
    back_ns = 0
    if ordered != written:  # largest distance to the maximum of the earlier times
        back_ns = max(top - t for top, t in zip(accumulate(written, max), written, strict=True))
    return Extent(len(written), ordered[0], ordered[-1], back_ns)


def timed(chunk: Any, times: Times) -> Any:
    """Return a chunk record with the range of its log times set, which no checksum covers."""
    span = span_of(extents_of(times).values()) or NO_TIME
    return dataclasses.replace(
        chunk, message_start_time=span.first_ns, message_end_time=span.last_ns
    )


def index_chunk(chunk: Any, start: int, length: int, times: Times) -> tuple[Any, bytes]:
    """Index a chunk record.

    Parameters
    ----------
    chunk : mcap.records.Chunk
    start, length : int
        Its offset in the file, and its size in bytes.
    times : dict
        Times and offsets of its messages.

    Returns
    -------
    entry : mcap.records.ChunkIndex
        For the summary section.
    message_indexes : bytes
        Records to follow the chunk: exactly one for each channel with messages in it, since
        readers take an incomplete set as complete.
    """
    blocks, offsets, at = [], {}, start + length
    for channel, entries in times.items():
        offsets[channel] = at
        blocks.append(pack(MessageIndex(channel_id=channel, records=entries)))
        at += len(blocks[-1])
    entry = ChunkIndex(
        message_start_time=chunk.message_start_time,
        message_end_time=chunk.message_end_time,
        chunk_start_offset=start,
        chunk_length=length,
        message_index_offsets=offsets,
        message_index_length=at - start - length,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        uncompressed_size=chunk.uncompressed_size,
    )
    return entry, b"".join(blocks)


class PackedChunk(NamedTuple):
    """A serialised chunk with its message indexes, and its data for the summary section."""

    block: bytes
    entry: Any
    times: Times


class ChunkBuilder:
    """Collects records for a chunk.

    Parameters
    ----------
    compress : bool
        Whether to compress with Zstandard.
    """

    def __init__(self, compress: bool) -> None:
        self._compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL) if compress else None
        self.clear()

    def clear(self) -> None:
        """Remove all records."""
        self._parts: list[bytes] = []
        self._times: Times = {}
        self.size = 0

    @property
    def has_messages(self) -> bool:
        """Whether there are messages, without which no chunk is written."""
        return bool(self._times)

    def add(self, record: bytes) -> None:
        """Add a serialised schema or channel record."""
        self._parts.append(record)
        self.size += len(record)

    def add_message(self, message: StoredMessage) -> None:
        """Add a message."""
        entries = self._times.setdefault(message.channel_id, [])
        entries.append((message.log_time_ns, self.size))
        self.add(pack_message(message))

    def packed(self) -> tuple[Any, Times]:
        """Return the collected records as a chunk record, and the times and offsets in it."""
        data, times = b"".join(self._parts), self._times
        chunk = Chunk(
            compression="zstd" if self._compressor else "",
            data=self._compressor.compress(data) if self._compressor else data,
            message_start_time=0,
            message_end_time=0,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        return timed(chunk, times), times

    def pack(self, start: int) -> PackedChunk:
        """Return the chunk of the collected records for a file offset; requires messages."""
        chunk, times = self.packed()
        head = chunk_head(chunk)
        length = len(head) + len(chunk.data)
        entry, message_indexes = index_chunk(chunk, start, length, times)
        block = b"".join((head, chunk.data, message_indexes))
        return PackedChunk(block, entry, times)


@dataclass
class Index:
    """Schemas, channels, chunks and metadata of a file, in the order of writing."""

    schemas: dict[int, Any] = field(default_factory=dict)
    channels: dict[int, Any] = field(default_factory=dict)
    extents: dict[int, Extent] = field(default_factory=dict)
    # Times with messages for each channel, with the resolution of chunks.
    stretches: dict[int, Stretches] = field(default_factory=dict)
    # Chunk index records, serialised to save memory: 170,000 for a day.
    chunks: list[bytes] = field(default_factory=list)
    chunks_bytes: int = 0
    metadata: list[Any] = field(default_factory=list)

    @property
    def messages(self) -> int:
        """Number of messages in the file."""
        return sum(extent.messages for extent in self.extents.values())

    def add_extents(self, extents: dict[int, Extent]) -> None:
        """Count messages of the file; :meth:`add_chunk` does so for those of a chunk."""
        for channel, extent in extents.items():
            self.extents[channel] = extent.joined(self.extents.get(channel))
            stretches = self.stretches.setdefault(channel, Stretches())
            stretches.add(Stretch(extent.first_ns, extent.last_ns))

    def add_chunk(self, entry: Any, times: Times) -> None:
        """Add the index of a chunk in the file, and count its messages."""
        self.add_extents(extents_of(times))
        self.chunks.append(pack(entry))
        self.chunks_bytes += len(self.chunks[-1])

    def add_metadata(self, name: str, start: int, length: int) -> None:
        """Add a metadata record in the file."""
        self.metadata.append(MetadataIndex(offset=start, length=length, name=name))

    def tail(self, offset: int) -> bytes:
        """Return everything after a data section that ends at ``offset``."""
        start = offset + len(DATA_END)
        summary, offsets = bytearray(), bytearray()
        for opcode, group in self._groups():
            if group:
                offsets += pack(SummaryOffset(opcode, start + len(summary), len(group)))
                summary += group
        at = start + len(summary)
        summary += offsets
        # The checksum includes the footer up to the checksum itself.
        footer = pack(Footer(start, at, 0))[:-4]
        checksum = zlib.crc32(footer, zlib.crc32(summary))
        return DATA_END + bytes(summary) + footer + checksum.to_bytes(4, "little") + MAGIC

    def _groups(self) -> Iterator[tuple[Opcode, bytes]]:
        yield Opcode.SCHEMA, b"".join(map(pack, self.schemas.values()))
        yield Opcode.CHANNEL, b"".join(map(pack, self.channels.values()))
        yield Opcode.STATISTICS, pack(self._statistics())
        yield Opcode.CHUNK_INDEX, b"".join(self.chunks)
        yield Opcode.METADATA_INDEX, b"".join(map(pack, self.metadata))

    def _statistics(self) -> Any:
        span = span_of(self.extents.values()) or NO_TIME
        return Statistics(
            attachment_count=0,
            channel_count=len(self.channels),
            channel_message_counts={n: extent.messages for n, extent in self.extents.items()},
            chunk_count=len(self.chunks),
            message_count=self.messages,
            message_start_time=span.first_ns,
            message_end_time=span.last_ns,
            metadata_count=len(self.metadata),
            schema_count=len(self.schemas),
        )


class Stretch(NamedTuple):
    """A time interval, both ends included."""

    first_ns: int
    last_ns: int


NO_TIME = Stretch(0, 0)  # as MCAP has it of a chunk or file without messages


def span_of(extents: Iterable[Extent | Stretch]) -> Stretch | None:
    """Return the time from the first message of all to the last; None without any.

    Examples
    --------
    >>> span_of([Stretch(7, 9), Stretch(0, 4)])
    Stretch(first_ns=0, last_ns=9)
    """
    ends = [(extent.first_ns, extent.last_ns) for extent in extents]
    return Stretch(min(ends)[0], max(last_ns for _, last_ns in ends)) if ends else None


def joined(stretches: Iterable[Stretch], hole_ns: int) -> list[Stretch]:
    """Sort stretches, and merge those at most ``hole_ns`` apart.

    Examples
    --------
    >>> joined([Stretch(7, 9), Stretch(0, 4), Stretch(5, 6)], 1)
    [Stretch(first_ns=0, last_ns=9)]
    """
    out: list[Stretch] = []
    for stretch in sorted(stretches):
        if out and stretch.first_ns - out[-1].last_ns <= hole_ns:
            out[-1] = Stretch(out[-1].first_ns, max(out[-1].last_ns, stretch.last_ns))
        else:
            out.append(stretch)
    return out


def at_most(stretches: Iterable[Stretch], hole_ns: int, most: int) -> tuple[list[Stretch], int]:
    """Merge stretches over ever longer holes, until few enough are left.

    Parameters
    ----------
    stretches : iterable of Stretch
    hole_ns : int
        Longest hole merged at first; it is doubled as often as necessary.
    most : int
        Number of stretches to be left at most.

    Returns
    -------
    stretches : list of Stretch
    hole_ns : int
        The longest hole that was merged.
    """
    out = joined(stretches, hole_ns)
    while len(out) > most:
        hole_ns = max(2 * hole_ns, 1)
        out = joined(out, hole_ns)
    return out, hole_ns


def usual_interval_ns(stretches: Iterable[Stretch], messages: int) -> int:
    """Return the usual interval between two messages of a topic.

    Parameters
    ----------
    stretches : iterable of Stretch
        Times with messages; rare messages have a stretch each.
    messages : int
        Number of messages in all of them.
    """
    there = sorted(stretches)
    if len(there) > 1 and messages < DENSE * len(there):
        return round(median(b.first_ns - a.first_ns for a, b in pairwise(there)))
    return sum(s.last_ns - s.first_ns for s in there) // max(messages, 1)


class Stretches:
    """Collects stretches.

    Attributes
    ----------
    hole_ns : int
        Holes up to this length are merged; it grows when there are too many stretches.
    """

    def __init__(self) -> None:
        self.hole_ns = SHORTEST_HOLE_NS
        self._found: list[Stretch] = []

    def add(self, stretch: Stretch) -> None:
        """Add a stretch, usually later than those before."""
        self._found[-1:] = joined([*self._found[-1:], stretch], self.hole_ns)
        if len(self._found) > KEPT:
            self._found, self.hole_ns = at_most(self._found, self.hole_ns, KEPT)

    def all(self) -> list[Stretch]:
        """Return the stretches in order."""
        return joined(self._found, self.hole_ns)
