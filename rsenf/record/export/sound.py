"""Luminance as sound: rows resampled to a uniform rate, as mono WAV with a description.

Between row times the luminance is interpolated linearly. The file states the scale of its samples.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rsenf import __version__
from rsenf.errors import InputError, UsageError
from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S
from rsenf.whole_file import whole_file

# An interval above this many frame periods means missing frames, which become silence.
_MISSING = 1.5

Signal = NDArray[np.float64]
SampleFormat = Literal["float32", "pcm16"]
# Format tag, sample type, and value of full scale.
_FORMATS: dict[str, tuple[int, str, float]] = {
    "float32": (3, "<f4", 1.0),
    "pcm16": (1, "<i2", 32767.0),
}
_LARGEST_BYTES = (1 << 32) - (1 << 16)  # WAV has 32-bit sizes


@dataclass(frozen=True)
class SoundStats:
    """Statistics of all frames, needed before the first sample."""

    first_pts_ns: int  # stream clock at the first and the last frame
    last_pts_ns: int
    frames: int  # number of frames
    frame_rate_hz: float  # measured between consecutive frames only, as some may be missing
    # (rows,) mean of each row over all frames: the static scene without flicker
    scene_levels: Signal
    peak_levels: float  # largest deviation of a row from its mean

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the end of the last."""
        return (self.last_pts_ns - self.first_pts_ns) / NS_PER_S + 1 / self.frame_rate_hz


def survey(blocks: Iterable[RowBlock]) -> SoundStats:
    """Compute the statistics of all blocks of one epoch.

    Raises
    ------
    InputError
        When there are fewer than two frames, or the number of rows changes.
    """
    total = least = most = np.empty(0)
    times = np.empty(0, np.int64)
    for block in blocks:
        level = block.profiles()
        if not times.size:
            total, least, most = np.zeros(block.rows), level.min(axis=0), level.max(axis=0)
        if level.shape[1] != total.size:
            raise InputError(f"the rows change from {total.size} to {block.rows}")
        total = total + level.sum(axis=0)
        least, most = np.minimum(least, level.min(axis=0)), np.maximum(most, level.max(axis=0))
        times = np.concatenate([times, block.frame_pts_ns])
    intervals_ns = np.diff(times)
    intervals_ns = intervals_ns[intervals_ns > 0]
    if not intervals_ns.size or times[-1] <= times[0]:
        raise InputError(f"too short for a sound: {times.size} frames")
    scene = total / times.size
    # Not the median: if every third frame is missing, half of the intervals are two periods.
    usual_ns = intervals_ns[intervals_ns < _MISSING * np.quantile(intervals_ns, 0.25)]
    return SoundStats(
        first_pts_ns=int(times[0]),
        last_pts_ns=int(times.max()),
        frames=times.size,
        frame_rate_hz=float(NS_PER_S / usual_ns.mean()),
        scene_levels=scene,
        peak_levels=float(np.maximum(most - scene, scene - least).max()),
    )


class Sampler:
    """Samples the luminance at a uniform rate.

    Row ``l`` of ``L`` is at ``l / L`` of the read-out time after the start of its frame. Between
    rows, and between the last row of a frame and the first of the next, the signal is interpolated
    linearly. A tone thus keeps its frequency for any number of rows, idle ratio and sample rate.

    Parameters
    ----------
    found : SoundStats
        Statistics of the same blocks.
    idle_ratio : float
        Share of the frame period in which no row is read, from 0 to below 1.
    rate_hz : int
        Sample rate.
    upwards : bool
        Whether the last row is read first.
    """

    def __init__(self, found: SoundStats, idle_ratio: float, rate_hz: int, upwards: bool) -> None:
        self._found, self._rate_hz, self._upwards = found, rate_hz, upwards
        self._period_s = 1 / found.frame_rate_hz
        rows = found.scene_levels.size
        read_out_s = (1 - idle_ratio) * self._period_s
        self._line_s = read_out_s / rows
        self._row_s = np.arange(rows) * self._line_s
        self._knots = np.empty((2, 0))  # times and levels; between blocks only the last row
        self._next = 0  # number of the next sample

    def samples(self, blocks: Iterable[RowBlock]) -> Iterator[Signal]:
        """Yield the signal piece by piece: deviations from the static scene, in levels."""
        for block in blocks:
            times_s, levels = self._frames(block)
            if not times_s.size:
                continue
            self._knots = np.hstack([self._knots, self._with_silence(times_s, levels)])
            yield self._up_to(self._knots[0, -1])
            self._knots = self._knots[:, -1:]
        yield self._up_to(self._found.duration_s)

    def _frames(self, block: RowBlock) -> tuple[Signal, Signal]:
        """Return times and levels of the frames that are later than all before them."""
        times_s = (block.frame_pts_ns - self._found.first_pts_ns) / NS_PER_S
        latest = np.maximum.accumulate(np.concatenate([[self._last_frame_s], times_s]))[:-1]
        later = times_s > latest
        levels = block.profiles() - self._found.scene_levels
        return times_s[later], (levels[:, ::-1] if self._upwards else levels)[later]

    @property
    def _last_frame_s(self) -> float:
        return float(self._knots[0, -1] - self._row_s[-1]) if self._knots.size else -np.inf

    def _with_silence(self, times_s: Signal, levels: Signal) -> Signal:
        """Return the knots of the signal (times, levels), with zeros where frames are missing."""
        pieces = []
        before_s = self._last_frame_s
        for time_s, level in zip(times_s, levels, strict=True):
            if np.isfinite(before_s) and time_s - before_s > _MISSING * self._period_s:
                ends = [before_s + self._row_s[-1] + self._line_s, time_s - self._line_s]
                pieces.append(np.array([ends, [0.0, 0.0]]))
            pieces.append(np.array([time_s + self._row_s, level]))
            before_s = time_s
        return np.hstack(pieces)

    def _up_to(self, end_s: float) -> Signal:
        """Return the samples before a time."""
        stop = int(np.ceil(end_s * self._rate_hz))
        times_s = np.arange(self._next, stop) / self._rate_hz
        self._next = max(stop, self._next)
        return np.interp(times_s, *self._knots)


@dataclass(frozen=True)
class SoundFile:
    """Parameters of the sound, including the scale from samples to levels."""

    rate_hz: int  # sample rate
    samples: int  # number of samples
    # value of a sample of 1.0 (full scale), in 8-bit levels of luma relative to the row's mean
    levels_per_unit: float
    frame_rate_hz: float  # timing of the rows
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
    sound = SoundFile(
        rate_hz, count, found.peak_levels or 1.0, found.frame_rate_hz, rows, idle_ratio,
        found.duration_s,
    )  # fmt: skip
    note = {**asdict(sound), **(about or {}), "removed": "the mean of each row over the sound"}
    sampler = Sampler(found, idle_ratio, rate_hz, upwards)
    factor = full_scale / sound.levels_per_unit
    with whole_file(out) as part, part.open("wb") as file:
        file.write(_head(tag, np.dtype(kind).itemsize, sound, json.dumps(note)))
        for piece in sampler.samples(blocks()):
            scaled = np.clip(piece * factor, -full_scale, full_scale)
            file.write((np.rint(scaled) if kind == "<i2" else scaled).astype(kind).tobytes())
    return sound


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
