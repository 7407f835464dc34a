"""Resamples row luminance to a uniform rate, by linear interpolation between row times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import InputError
from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S

# An interval above this many frame periods means missing frames, which become silence.
_MISSING = 1.5

Signal = NDArray[np.float64]


@dataclass(frozen=True)
class Survey:
    """Statistics of all frames, needed before the first sample.

    Attributes
    ----------
    first_pts_ns, last_pts_ns : int
        Stream clock at the first and the last frame.
    frames : int
        Number of frames.
    frame_rate_hz : float
        Measured between consecutive frames only, as some may be missing.
    scene_levels : ndarray, shape (rows,)
        Mean of each row over all frames: the static scene without flicker.
    peak_levels : float
        Largest deviation of a row from its mean.
    """

    first_pts_ns: int
    last_pts_ns: int
    frames: int
    frame_rate_hz: float
    scene_levels: Signal
    peak_levels: float

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the end of the last."""
        return (self.last_pts_ns - self.first_pts_ns) / NS_PER_S + 1 / self.frame_rate_hz


def survey(blocks: Iterable[RowBlock]) -> Survey:
    """Compute the statistics of all blocks of one epoch.

    Raises
    ------
    InputError
        When there are fewer than two frames, or the number of rows changes.
    """
    total = least = most = np.empty(0)
    times = np.empty(0, np.int64)
    for block in blocks:
        level = row_levels(block)
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
    return Survey(
        first_pts_ns=int(times[0]),
        last_pts_ns=int(times[-1]),
        frames=times.size,
        frame_rate_hz=float(NS_PER_S / usual_ns.mean()),
        scene_levels=scene,
        peak_levels=float(np.maximum(most - scene, scene - least).max()),
    )


def row_levels(block: RowBlock) -> Signal:
    """Return the mean of each row over its strips, shape (frames, rows), in levels."""
    levels: Signal = np.mean(block.level, axis=2, dtype=np.float64)
    return levels


class Sampler:
    """Samples the luminance at a uniform rate.

    Row ``l`` of ``L`` is at ``l / L`` of the read-out time after the start of its frame. Between
    rows, and between the last row of a frame and the first of the next, the signal is interpolated
    linearly. A tone thus keeps its frequency for any number of rows, idle ratio and sample rate.

    Parameters
    ----------
    found : Survey
        Statistics of the same blocks.
    idle_ratio : float
        Share of the frame period in which no row is read, from 0 to below 1.
    rate_hz : int
        Sample rate.
    upwards : bool
        Whether the last row is read first.
    """

    def __init__(self, found: Survey, idle_ratio: float, rate_hz: int, upwards: bool) -> None:
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
        levels = row_levels(block) - self._found.scene_levels
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
