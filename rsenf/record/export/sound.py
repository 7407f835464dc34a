"""Luminance as sound: mono WAV with a description of its samples."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rsenf import __version__
from rsenf.errors import UsageError
from rsenf.messages import RowBlock
from rsenf.record.export.luminance import Sampler, Survey, survey
from rsenf.whole_file import whole_file

SampleFormat = Literal["float32", "pcm16"]

# Format tag, sample type, and value of full scale.
_FORMATS: dict[str, tuple[int, str, float]] = {
    "float32": (3, "<f4", 1.0),
    "pcm16": (1, "<i2", 32767.0),
}
_LARGEST_BYTES = (1 << 32) - (1 << 16)  # WAV has 32-bit sizes


@dataclass(frozen=True)
class SoundFile:
    """Parameters of the sound, including the scale from samples to levels.

    Attributes
    ----------
    rate_hz : int
        Sample rate.
    samples : int
        Number of samples.
    levels_per_unit : float
        Value of a sample of 1.0 (full scale), in 8-bit levels of luma relative to the row's mean.
    frame_rate_hz, rows, idle_ratio
        Timing of the rows.
    """

    rate_hz: int
    samples: int
    levels_per_unit: float
    frame_rate_hz: float
    rows: int
    idle_ratio: float
    duration_s: float


def write_sound(
    blocks: Callable[[], Iterable[RowBlock]],
    out: Path,
    *,
    idle_ratio: float,
    upwards: bool = False,
    sample_format: SampleFormat = "float32",
    about: dict[str, Any] | None = None,
) -> SoundFile:
    """Write the luminance of the rows as sound, at the rate at which rows were read.

    Each row's mean is subtracted to remove the scene; the rest is normalised to full scale. The
    file contains the factor (LIST/INFO, ICMT, as JSON).

    Parameters
    ----------
    blocks : callable
        Returns the row blocks of one epoch, in order; called twice.
    out : Path
        The file; replaced once it is complete.
    idle_ratio : float
        Share of the frame period in which no row is read; a wrong one shifts all frequencies.
    upwards : bool
        Whether the last row is read first.
    sample_format : {'float32', 'pcm16'}
    about : dict, optional
        Further notes for the file.

    Raises
    ------
    UsageError
        When the idle ratio is invalid, or the sound is longer than a WAV can be.
    InputError
        When there are too few frames.
    RecordingError
        When the file can't be written.
    """
    if not 0 <= idle_ratio < 1:
        raise UsageError(f"an idle ratio of {idle_ratio}", "it is from 0 to below 1")
    found = survey(blocks())
    rows = found.scene_levels.size
    rate_hz = max(round(rows * found.frame_rate_hz / (1 - idle_ratio)), 1)
    tag, kind, full_scale = _FORMATS[sample_format]
    count = int(np.ceil(found.duration_s * rate_hz))
    if count * np.dtype(kind).itemsize > _LARGEST_BYTES:
        raise UsageError(
            f"{found.duration_s:.0f} s at {rate_hz} Hz are more than a WAV can hold",
            "--samples pcm16 takes half the room; or export it as a table",
        )
    sound = _described(found, rate_hz, count, idle_ratio)
    note = {**asdict(sound), **(about or {}), "removed": "the mean of each row over the sound"}
    sampler = Sampler(found, idle_ratio, rate_hz, upwards)
    factor = full_scale / sound.levels_per_unit
    with whole_file(out) as part, part.open("wb") as file:
        file.write(_head(tag, np.dtype(kind).itemsize, sound, json.dumps(note)))
        for piece in sampler.samples(blocks()):
            scaled = np.clip(piece * factor, -full_scale, full_scale)
            file.write((np.rint(scaled) if kind == "<i2" else scaled).astype(kind).tobytes())
    return sound


def _described(found: Survey, rate_hz: int, count: int, idle_ratio: float) -> SoundFile:
    return SoundFile(
        rate_hz=rate_hz,
        samples=count,
        levels_per_unit=found.peak_levels or 1.0,
        frame_rate_hz=found.frame_rate_hz,
        rows=found.scene_levels.size,
        idle_ratio=idle_ratio,
        duration_s=found.duration_s,
    )


def _head(tag: int, width: int, sound: SoundFile, note: str) -> bytes:
    """Return the RIFF header up to the samples ('fact' is required for float samples)."""
    rate = sound.rate_hz
    body = b"WAVE" + _chunk(
        b"fmt ", struct.pack("<HHIIHHH", tag, 1, rate, rate * width, width, 8 * width, 0)
    )
    body += _chunk(b"fact", struct.pack("<I", sound.samples))
    info = _chunk(b"ISFT", f"rsenf {__version__}".encode() + b"\0")
    info += _chunk(b"ICMT", note.encode() + b"\0")
    body += _chunk(b"LIST", b"INFO" + info)
    size = sound.samples * width
    return (
        struct.pack("<4sI", b"RIFF", len(body) + 8 + size)
        + body
        + struct.pack("<4sI", b"data", size)
    )


def _chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack("<4sI", name, len(content)) + content + b"\0" * (len(content) % 2)
