"""Estimates one frequency a second from a WAV recording of the mains voltage.

The signal is mixed down by a nominal frequency and summed over tenths of a second; the nulls of
such sums lie on all other harmonics of 50 and 60 Hz. The least-squares slope of the unwrapped phase
over the ten sums of a second is its frequency. The scatter of the phases about the line gives the
standard error, which is large in a second without a tone.

Files hold PCM of 8, 16, 24 or 32 bits, or 32-bit float. The standard library's reader refuses the
extensible header that most 24-bit recorders write.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray
from rsenf.reference.reference import Notes

PCM, FLOAT, EXTENSIBLE = 1, 3, 0xFFFE
SUMS_HZ = 10
MAX_STD_HZ = 0.005  # a quarter of the grid's own variation
BLOCK_S = 60
# Nominal frequency of the grid and the harmonic that may carry it.
TONES = ((50.0, 1), (60.0, 1), (50.0, 2), (60.0, 2))


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


def demodulate(path: Path, nominal_hz: float | None, notes: Notes) -> FloatArray:
    """Estimate the grid's frequency from a recording of the mains, or of its hum.

    Parameters
    ----------
    path : Path
        WAV, PCM or 32-bit float, any rate of at least 250 Hz; the first channel is used.
    nominal_hz : float, optional
        50 or 60; the one that is found if None.
    notes : Notes

    Returns
    -------
    ndarray of float, shape (seconds,)
        One frequency (Hz) per whole second, NaN where there is no clear tone.

    Raises
    ------
    ReferenceFormatError
        If it can't be read, is shorter than two seconds, or has no mains tone.
    """
    wav = open_wav(path)
    tones = tones_within(wav.rate_hz, nominal_hz)
    if wav.frames < 2 * wav.rate_hz or not tones:
        raise ReferenceFormatError(
            f"{path.name}: {wav.frames / wav.rate_hz:.1f} s at {wav.rate_hz} Hz",
            "the recording must last 2 s at 250 Hz or more",
        )
    # A block of 60 s holds whole periods of every carrier, so each starts at phase zero.
    blocks, carriers_hz = wav.first_channel(BLOCK_S * wav.rate_hz), [n * h for n, h in tones]
    sums = np.concatenate([tenths(x, wav.rate_hz, carriers_hz) for x in blocks], axis=1)
    found = [frequencies(z) for z in sums]
    # Standard error of the ENF: half that of the second harmonic.
    errors = [std / h for (_, std), (_, h) in zip(found, tones, strict=True)]
    best = int(np.argmin([np.median(e) for e in errors]))
    (nominal, harmonic), offset_hz = tones[best], found[best][0]
    good = errors[best] <= MAX_STD_HZ
    if good.sum() < 2:
        raise ReferenceFormatError(
            f"{path.name}: no mains tone near 50, 60, 100 or 120 Hz", "is it a recording of mains?"
        )
    notes.say(f"{tone_text(nominal, harmonic)} used")
    if wav.channels > 1:
        notes.say(f"first of {wav.channels} channels used")
    notes.count("seconds without a clear tone, taken as gaps", (~good).sum())
    return np.where(good, nominal + offset_hz / harmonic, np.nan)


def tone_text(nominal_hz: float, harmonic: int) -> str:
    """Return the name of a tone of the mains."""
    return f"{'fundamental' if harmonic == 1 else 'second harmonic'} of {nominal_hz:g} Hz"


def tones_within(rate_hz: float, nominal_hz: float | None) -> list[tuple[float, int]]:
    """Return the nominal frequencies and harmonics that a sampling rate allows.

    Parameters
    ----------
    rate_hz : float
    nominal_hz : float, optional
        50 or 60; both if None.

    Examples
    --------
    >>> tones_within(250.0, 50.0)
    [(50.0, 1), (50.0, 2)]
    """
    return [(n, h) for n, h in TONES if nominal_hz in (None, n) and 2.5 * n * h <= rate_hz]


def tenths(
    samples: FloatArray, rate_hz: int, carriers_hz: Sequence[float]
) -> NDArray[np.complex128]:
    """Mix a signal down by each carrier, and sum it over whole tenths of a second.

    Parameters
    ----------
    samples : ndarray of float, shape (n,)
        They begin with a whole second.
    rate_hz : int
        Sampling rate.
    carriers_hz : sequence of float
        Whole numbers, so that their phase is zero at each second.

    Returns
    -------
    ndarray of complex, shape (carriers, tenths)
    """
    whole = samples.size * SUMS_HZ // rate_hz
    edges = np.arange(whole + 1) * rate_hz // SUMS_HZ
    if not whole:
        return np.empty((len(carriers_hz), 0), np.complex128)
    t_s = np.arange(edges[-1]) / rate_hz
    used = samples[: edges[-1]] - samples.mean()
    turns = [np.exp(-2j * np.pi * f * t_s) for f in carriers_hz]
    return np.array([np.add.reduceat(used * turn, edges[:-1]) for turn in turns])


def frequencies(sums: NDArray[np.complex128]) -> tuple[FloatArray, FloatArray]:
    """Offset from the carrier in each whole second, and its standard error (Hz).

    Parameters
    ----------
    sums : ndarray of complex, shape (n,)
        Of one carrier, by :func:`tenths`.

    Examples
    --------
    >>> t_s = np.arange(10) / 10
    >>> offset_hz, _ = frequencies(np.exp(2j * np.pi * 0.02 * t_s))
    >>> offset_hz.round(6).tolist()
    [0.02]
    """
    whole = sums[: sums.size // SUMS_HZ * SUMS_HZ].reshape(-1, SUMS_HZ)
    phase = np.unwrap(np.angle(whole), axis=1)
    t_s = (np.arange(SUMS_HZ) + 0.5) / SUMS_HZ - 0.5
    power = t_s @ t_s
    slope = phase @ t_s / power
    residual = phase - phase.mean(axis=1, keepdims=True) - slope[:, None] * t_s
    variance = (residual**2).sum(axis=1) / (SUMS_HZ - 2)
    return slope / (2 * np.pi), np.sqrt(variance / power) / (2 * np.pi)
