"""Builds MCAP chunks: concatenated, compressed records, followed by their message indexes."""

from __future__ import annotations

import dataclasses
import zlib
from itertools import accumulate
from operator import itemgetter
from typing import Any, NamedTuple

import zstandard
from mcap.records import Chunk, ChunkIndex, MessageIndex

from rsenf.record.container import StoredMessage, chunk_head, pack, pack_message

ZSTD_LEVEL = 1  # higher levels don't compress noise any better, and take several times as long

# Log time (ns) and offset in the uncompressed chunk of each message, by channel.
Times = dict[int, list[tuple[int, int]]]


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
    extents = extents_of(times).values()
    return dataclasses.replace(
        chunk,
        message_start_time=min((extent.first_ns for extent in extents), default=0),
        message_end_time=max((extent.last_ns for extent in extents), default=0),
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
    extents: dict[int, Extent]


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
        return PackedChunk(block, entry, extents_of(times))
