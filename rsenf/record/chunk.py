"""A chunk in the making: records joined, compressed, and followed by their message index."""

from __future__ import annotations

import dataclasses
import zlib
from itertools import accumulate
from operator import itemgetter
from typing import Any, NamedTuple

import zstandard
from mcap.records import Chunk, ChunkIndex, MessageIndex

from rsenf.record.container import StoredMessage, chunk_head, pack, pack_message

ZSTD_LEVEL = 1  # higher levels shrink noise no further, and cost several times as much

# Log time, and offset within the unpacked chunk, of each message of each channel.
Times = dict[int, list[tuple[int, int]]]


class Extent(NamedTuple):
    """How many messages a channel has, between which log times, and how far these go back."""

    messages: int
    first_ns: int
    last_ns: int
    back_ns: int = 0

    def joined(self, earlier: Extent | None) -> Extent:
        """Return the extent of both together, of which this was written later."""
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
    if ordered != written:  # how far a time lies before the highest of those written earlier
        back_ns = max(top - t for top, t in zip(accumulate(written, max), written, strict=True))
    return Extent(len(written), ordered[0], ordered[-1], back_ns)


def timed(chunk: Any, times: Times) -> Any:
    """Return a chunk record that says the log times of its messages, which no checksum covers."""
    extents = extents_of(times).values()
    return dataclasses.replace(
        chunk,
        message_start_time=min((extent.first_ns for extent in extents), default=0),
        message_end_time=max((extent.last_ns for extent in extents), default=0),
    )


def index_chunk(chunk: Any, start: int, length: int, times: Times) -> tuple[Any, bytes]:
    """Index a chunk record that lies at ``start`` of the file and is ``length`` bytes long.

    Returns
    -------
    entry : mcap.records.ChunkIndex
        For the end of the file.
    message_indexes : bytes
        Records to follow the chunk: exactly one for each channel that has messages in it, since
        readers take an incomplete set for the whole.
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
    """A chunk as it goes into the file, and what the file's end has to know about it."""

    block: bytes
    entry: Any
    extents: dict[int, Extent]


class ChunkBuilder:
    """Collects records until they are packed.

    Parameters
    ----------
    compress : bool
        Whether to compress with Zstandard.
    """

    def __init__(self, compress: bool) -> None:
        self._compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL) if compress else None
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self._parts: list[bytes] = []
        self._times: Times = {}
        self.size = 0

    @property
    def has_messages(self) -> bool:
        """Whether there is anything worth packing."""
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
        """Return what was collected as a chunk record, and the times and places in it."""
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
        """Pack what was collected, which has messages, into the chunk at a file offset."""
        chunk, times = self.packed()
        head = chunk_head(chunk)
        length = len(head) + len(chunk.data)
        entry, message_indexes = index_chunk(chunk, start, length, times)
        block = b"".join((head, chunk.data, message_indexes))
        return PackedChunk(block, entry, extents_of(times))
