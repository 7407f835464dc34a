"""The MCAP container: a sequence of records, some of them in chunks (https://mcap.dev/spec).

The record classes of the ``mcap`` library define the content of records. This module finds their
boundaries, and checks every length against the data before using it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode

from rsenf.errors import InputError

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
CHANNEL, MESSAGE = struct.Struct("<H"), struct.Struct("<HIQQ")
CHUNK, SIZE, SHORT_SIZE = struct.Struct("<QQQI"), struct.Struct("<Q"), struct.Struct("<I")
_TIMES, _TIME = struct.Struct("<HI"), struct.Struct("<QQ")
LARGEST_CHUNK_BYTES = 1 << 28  # uncompressed; usual chunks have a few MB
LARGEST_RECORD_BYTES = 1 << 29  # of records that are read into memory

_READ = {int(code) for code in Opcode} - {int(Opcode.ATTACHMENT)}


class DamagedError(Exception):
    """A record whose content is invalid for its kind."""


class Record(NamedTuple):
    """One record: kind, start and end in the file, content."""

    opcode: int
    start: int
    end: int
    body: bytes


class StoredMessage(NamedTuple):
    """A message record of the container."""

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


def check_magic(path: Path, stream: BinaryIO) -> None:
    """Check that a file begins with the magic bytes of MCAP.

    Parameters
    ----------
    path : Path
        For messages.
    stream : binary file
        At its beginning.

    Raises
    ------
    InputError
        When it doesn't.
    """
    begin = stream.read(len(MAGIC))
    if not begin:
        raise InputError(f"{path}: the file is empty")
    if begin != MAGIC:
        raise InputError(f"{path}: not an MCAP recording")


def heads(stream: BinaryIO, start: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield kind, start and end of all complete records from ``start``, until one exceeds ``end``.

    Their content is skipped: whoever wants a record's finds the stream at the start of it.

    Parameters
    ----------
    stream : binary file
    start, end : int
        Offsets in the file.
    """
    while start + HEAD.size <= end:
        stream.seek(start)
        head = stream.read(HEAD.size)
        if len(head) < HEAD.size:
            return
        opcode, length = HEAD.unpack(head)
        stop = start + HEAD.size + length
        if opcode == 0 or stop > end:  # 0 is no valid kind, but may be left by a power failure
            return
        yield opcode, start, stop
        start = stop


def walk(stream: BinaryIO, start: int, end: int) -> Iterator[Record]:
    """Yield all complete records from ``start`` with their content, as :func:`heads`.

    Unused kinds (attachments, private ones) are returned without their content.
    """
    for opcode, begin, stop in heads(stream, start, end):
        length = stop - begin - HEAD.size if opcode in _READ else 0
        if length > LARGEST_RECORD_BYTES:
            return
        body = stream.read(length)
        if len(body) < length:
            return
        yield Record(opcode, begin, stop, body)


def pack(record: Any) -> bytes:
    """Serialise a record of the ``mcap`` library."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


def pack_message(message: StoredMessage) -> bytes:
    """Serialise a message record."""
    head = HEAD.pack(Opcode.MESSAGE, MESSAGE.size + len(message.data))
    return b"".join((head, MESSAGE.pack(*message[:4]), message.data))


def chunk_head(chunk: Any) -> bytes:
    """Serialise a chunk record up to its data; avoids copying the data, about a megabyte."""
    compression: bytes = chunk.compression.encode()
    times = chunk.message_start_time, chunk.message_end_time
    fields = CHUNK.pack(*times, chunk.uncompressed_size, chunk.uncompressed_crc)
    fields += SHORT_SIZE.pack(len(compression)) + compression + SIZE.pack(len(chunk.data))
    return HEAD.pack(Opcode.CHUNK, len(fields) + len(chunk.data)) + fields


def unpack(kind: Any, body: bytes) -> Any:
    """Parse a record's content with a record class of the ``mcap`` library.

    Raises
    ------
    DamagedError
        When it can't be parsed, or its length is wrong.
    """
    stream = ReadDataStream(BytesIO(body))
    try:
        record = kind.read(stream)
    except (struct.error, EndOfFile, UnicodeDecodeError, OverflowError) as exc:
        raise DamagedError(f"a {kind.__name__} record that can't be parsed") from exc
    if stream.count != len(body):
        raise DamagedError(f"a {kind.__name__} record of a wrong length")
    return record


def unpack_message(body: bytes) -> StoredMessage:
    """Parse a message record's content.

    Raises
    ------
    DamagedError
        When it is too short to be one.
    """
    if len(body) < MESSAGE.size:
        raise DamagedError("a Message record that is too short")
    return StoredMessage._make((*MESSAGE.unpack_from(body), body[MESSAGE.size :]))


def unpack_times(body: bytes) -> tuple[int, list[tuple[int, int]]]:
    """Parse a message index record's content: a channel, and time and offset of each message.

    Several times as fast as the ``mcap`` library, which matters with an entry for each message.

    Raises
    ------
    DamagedError
        When it is of a wrong length.
    """
    if len(body) < _TIMES.size:
        raise DamagedError("a MessageIndex record that is too short")
    channel, length = _TIMES.unpack_from(body)
    entries = body[_TIMES.size :]
    if length != len(entries) or length % _TIME.size:
        raise DamagedError("a MessageIndex record of a wrong length")
    return channel, list(_TIME.iter_unpack(entries))


def unpack_chunk(chunk: Any, *, checked: bool = True) -> bytes:
    """Return the records inside a chunk, after decompression and a check of their checksum.

    Parameters
    ----------
    chunk : mcap.records.Chunk
    checked : bool
        Whether a missing checksum, which the format allows, counts as damage.

    Raises
    ------
    DamagedError
        When the chunk fails its checksum, can't be decompressed, or claims an implausible size.
    """
    size = chunk.uncompressed_size
    if size > LARGEST_CHUNK_BYTES:
        raise DamagedError(f"a chunk that claims {size} bytes")
    try:
        data = _decompressed(chunk.compression, chunk.data, size)
    except (zstandard.ZstdError, ValueError, RuntimeError, MemoryError) as exc:
        raise DamagedError("a chunk that can't be decompressed") from exc
    if len(data) != size:
        raise DamagedError(f"a chunk of {len(data)} bytes that claims {size}")
    if (checked or chunk.uncompressed_crc) and zlib.crc32(data) != chunk.uncompressed_crc:
        raise DamagedError("a chunk that fails its checksum")
    return data


def _decompressed(compression: str, data: bytes, size: int) -> bytes:
    """Decompress without allocating more than the claimed size."""
    if compression == "":
        return data
    if compression == "zstd":
        if zstandard.frame_content_size(data) not in (size, -1):
            raise ValueError("announces another size")
        return zstandard.decompress(data, size)
    if compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        return bytes(LZ4FrameDecompressor().decompress(data, max_length=size))
    raise DamagedError(f"a chunk compressed by {compression!r}, which isn't known")
