"""Reads samples of a WAV file in pieces: PCM of 8, 16, 24 and 32 bits, and 32-bit float.

The standard library's reader refuses the extensible header that most 24-bit recorders write.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray

PCM, FLOAT, EXTENSIBLE = 1, 3, 0xFFFE


@dataclass(frozen=True)
class WavFile:
    """Position and format of a WAV file's samples; ``start`` is their byte offset."""

    path: Path
    rate_hz: int
    channels: int
    bits: int
    is_float: bool
    start: int
    frames: int

    @property
    def frame_bytes(self) -> int:
        """Bytes of one sample of all channels."""
        return self.bits // 8 * self.channels

    def first_channel(self, frames: int, begin: int = 0) -> Iterator[FloatArray]:
        """Yield the first channel from sample ``begin`` on, ``frames`` at a time; full scale 1."""
        width = self.bits // 8
        with self.path.open("rb") as file:
            file.seek(self.start + begin * self.frame_bytes)
            for first in range(begin, self.frames, frames):
                count = min(frames, self.frames - first)
                raw = file.read(count * self.frame_bytes)
                cells = np.frombuffer(raw, np.uint8)
                whole = cells.size // self.frame_bytes * self.frame_bytes
                yield self._values(cells[:whole].reshape(-1, self.channels, width)[:, 0])

    def _values(self, cells: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> FloatArray:
        """Decode samples of shape (n, bytes)."""
        if self.is_float:
            return np.frombuffer(cells.tobytes(), "<f4").astype(np.float64)
        if self.bits == 8:
            return (cells[:, 0].astype(np.float64) - 128.0) / 128.0
        # Left-aligned in 32 bits, all widths have the same sign bit and full scale.
        wide = np.zeros((cells.shape[0], 4), np.uint8)
        wide[:, 4 - cells.shape[1] :] = cells
        return np.frombuffer(wide.tobytes(), "<i4") / 2.0**31


def open_wav(path: Path) -> WavFile:
    """Read the header of a WAV file.

    Raises
    ------
    ReferenceFormatError
        If it is no WAV file, or has a coding other than PCM or 32-bit float.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(4) != b"RIFF" or file.read(8)[4:] != b"WAVE":
            raise ReferenceFormatError(f"{path.name} is no WAV file")
        layout = None
        while True:
            head = file.read(8)
            if len(head) < 8:
                raise ReferenceFormatError(f"{path.name} has no samples")
            kind, length = head[:4], struct.unpack("<I", head[4:])[0]
            if kind == b"fmt ":
                layout = _layout(file, length, path.name)
            elif kind == b"data" and layout is not None:
                break
            else:
                file.seek(length + length % 2, 1)
        start = file.tell()
    coding, channels, rate_hz, bits = layout
    # A recorder that was interrupted leaves the length at 0 or at its maximum.
    available = size - start
    length = min(length, available) if length else available
    frames = length // (channels * bits // 8)
    return WavFile(path, rate_hz, channels, bits, coding == FLOAT, start, frames)


def _layout(file: BinaryIO, length: int, where: str) -> tuple[int, int, int, int]:
    """Read coding, channels, rate and bits from a format chunk."""
    chunk = file.read(length + length % 2)
    if len(chunk) < 16:
        raise ReferenceFormatError(f"{where}: its header is cut off")
    coding, channels, rate_hz, _, _, bits = struct.unpack("<HHIIHH", chunk[:16])
    if coding == EXTENSIBLE and len(chunk) >= 26:
        (coding,) = struct.unpack("<H", chunk[24:26])
    known = (coding == PCM and bits in (8, 16, 24, 32)) or (coding == FLOAT and bits == 32)
    if not known or not channels or not rate_hz:
        raise ReferenceFormatError(
            f"{where}: WAV coding {coding} with {bits} bits", "convert it to 16-bit PCM"
        )
    return coding, channels, rate_hz, bits
