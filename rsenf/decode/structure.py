"""Detects truncated video files by the lengths in their outermost structure.

FFmpeg reads a truncated Matroska or AVI file to its end without an error, and reports only
"invalid data" for an MP4 whose index was never written.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import BinaryIO

_EBML, _SEGMENT = 0x1A45DFA3, 0x18538067
# Boxes that pictures are read from. Any other one may be incomplete, or be junk appended by a
# camera, without any frame missing.
_MP4_PICTURES = (b"mdat", b"moov", b"moof")
_MP4_FIRST = (*_MP4_PICTURES, b"ftyp", b"wide", b"free", b"skip", b"pnot", b"styp")
# Length field of a RIFF file that was not finished.
_RIFF_OPEN = (0, 0xFFFFFFFF)


def missing_bytes(path: Path) -> int:
    """Return how many bytes are missing at the end of a file; 0 if none, or if unknown.

    Knows MP4 and QuickTime boxes (ISO/IEC 14496-12, 4.2), Matroska and WebM elements (RFC 8794),
    and RIFF chunks (AVI).
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
        if head[4:8] in _MP4_FIRST:
            ends = (end for kind, end in _boxes(file, size) if kind in _MP4_PICTURES)
            return max(0, max(ends, default=0) - size)
        if head[:4] == _EBML.to_bytes(4):
            return max(0, _segment_end(file) - size)
        if head[:4] == b"RIFF":
            return max(0, _riff_end(file, size) - size)
    return 0


def lacks_index(path: Path) -> bool:
    """Whether a file is an MP4 or QuickTime file without its index (``moov``)."""
    with path.open("rb") as file:
        if file.read(8)[4:8] not in _MP4_FIRST:
            return False
        return all(kind != b"moov" for kind, _ in _boxes(file, path.stat().st_size))


def _boxes(file: BinaryIO, size: int) -> list[tuple[bytes, int]]:
    """Return type and end offset of each outermost box."""
    found: list[tuple[bytes, int]] = []
    start = 0
    while start + 8 <= size:
        file.seek(start)
        length, kind = struct.unpack(">I4s", file.read(8))
        if length == 1:
            length = int.from_bytes(file.read(8))
        elif length == 0:
            length = size - start  # to the end of the file
        if length < 8:
            break
        start += length
        found.append((kind, start))
    return found


def _segment_end(file: BinaryIO) -> int:
    """Return the end offset of a Matroska file's segment; 0 if its length is unknown."""
    file.seek(0)
    for _ in range(4):  # the header, perhaps padding, the segment
        kind = _vint(file, keep_marker=True)
        length = _vint(file)
        if length is None:
            return 0
        if kind == _SEGMENT:
            return file.tell() + length
        file.seek(length, os.SEEK_CUR)
    return 0


def _vint(file: BinaryIO, *, keep_marker: bool = False) -> int | None:
    """Read an EBML variable-size integer; None for "unknown" and at the end of the file."""
    first = file.read(1)
    if not first or not first[0]:
        return None
    extra = 8 - first[0].bit_length()
    rest = file.read(extra)
    bits = 7 * (extra + 1)
    value = int.from_bytes(first + rest)
    if keep_marker:
        return value
    value &= (1 << bits) - 1
    return None if value == (1 << bits) - 1 else value


def _riff_end(file: BinaryIO, size: int) -> int:
    """Return the end offset of the last finished RIFF chunk: long AVI files have several."""
    end = 0
    while end + 8 <= size:
        file.seek(end)
        kind, length = struct.unpack("<4sI", file.read(8))
        if kind != b"RIFF" or length in _RIFF_OPEN:
            break
        end += 8 + length
    return end
