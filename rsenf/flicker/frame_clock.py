"""The camera's frame rate, whatever frames are missing from its stream and however stamps jitter.

A free-running sensor begins its frames at even times; a driver or a network stamps them when they
arrive. Jitter of 4 ms turns the phase of light at 100 Hz by 2.5 rad, and nothing of it is left. By
the straight line through the stamps over the frame numbers it is there again. What remains is the
error of the line's slope, which all frequencies share.
"""

from __future__ import annotations

import dataclasses
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import RowBlock
from rsenf.messages.schema import Int64Array
from rsenf.timebase import NS_PER_S

Float = NDArray[np.float64]
Int = NDArray[np.int64]

MIN_FRAMES = 16  # fewer don't tell a frame that is missing from stamps that jitter
COUNTED_FRAMES = 32  # whose periods are counted together
MIN_JITTER_S = 5e-4  # rms; less turns the light's phase by a third of a radian at most
MOST_OFF = 0.5  # frame periods by which a stamp may be off the line: beyond, a frame is missing
MOST_ALIKE = 0.5  # correlation of neighbouring stamps' errors; more is a rate that varies


class RegularClock:
    """Line through time stamps over frame numbers (ordinary least squares, running sums).

    Frames keep to the line that was known when the clock was made: a later one would move what is
    out already. By how much the light's frequency is off for that, ``rate_ratio`` says.

    Parameters
    ----------
    number : ndarray of int64, shape (frames,)
    stamp_s : ndarray, shape (frames,)
        Time stamps since the stream's first frame.
    """

    def __init__(self, number: Int, stamp_s: Float) -> None:
        self._first, self._missing = int(number[0]), 0
        self._sums = np.zeros(5)  # of 1, n, t, n², n·t
        self._left_power = 0.0
        place = (number - self._first).astype(np.float64)
        self._add(place, stamp_s)
        self._period_s, self._begin_s = self._line()
        left = stamp_s - self._begin_s - self._period_s * place
        self._left_power = float(left @ left)
        self.jitter_s = float(np.sqrt(self._left_power / left.size))
        self.most_off = float(np.abs(left).max()) / self._period_s
        self.alike = float(left[1:] @ left[:-1]) / max(self._left_power, 1e-30)

    @classmethod
    def fit(cls, number: Int, stamp_s: Float) -> Self | None:
        """Fit a clock to stamps that jitter; None where they don't, or aren't of even frames."""
        if number.size < MIN_FRAMES or not number[-1] > number[0]:
            return None
        clock = cls(number, stamp_s)
        jitters = clock.jitter_s > MIN_JITTER_S and clock.alike < MOST_ALIKE
        return clock if jitters and clock.most_off < MOST_OFF else None

    @property
    def frame_rate_hz(self) -> float:
        """Frames a second that the clock was made with."""
        return 1.0 / self._period_s

    @property
    def rate_ratio(self) -> tuple[float, float]:
        """Frame rate by all stamps so far over that of the clock, and its standard error."""
        count, n, _, nn, _ = self._sums
        period_s, _ = self._line()
        variance = self._left_power / max(count - 2.0, 1.0) / (nn - n * n / count)
        return self._period_s / period_s, float(np.sqrt(variance)) / period_s

    def times(self, number: Int) -> Float:
        """When frames were taken, since the first, shape (frames,)."""
        place = number - self._first + self._missing
        return np.asarray(self._begin_s + self._period_s * place)

    def regular(self, block: RowBlock, origin_ns: int) -> RowBlock:
        """Give a block's frames even times, and learn from their stamps."""
        stamp_s = (block.frame_pts_ns - origin_ns) / NS_PER_S
        place = (block.frame_number - self._first + self._missing).astype(np.float64)
        period_s, begin_s = self._line()
        left = stamp_s - begin_s - period_s * place
        # A gap that the numbers don't tell of: all that follow are late by whole frames.
        if late := round(float(np.median(left)) / period_s):
            self._missing += late
            place, left = place + late, left - late * period_s
        self._add(place, stamp_s)
        self._left_power += float(left @ left)
        pts_ns = origin_ns + np.rint(self.times(block.frame_number) * NS_PER_S).astype(np.int64)
        return dataclasses.replace(block, frame_pts_ns=pts_ns)

    def _add(self, place: Float, stamp_s: Float) -> None:
        one = np.ones_like(place)
        self._sums += [
            float(x @ y) for x, y in
            ((one, one), (one, place), (one, stamp_s), (place, place), (place, stamp_s))
        ]  # fmt: skip

    def _line(self) -> tuple[float, float]:
        """Slope and intercept."""
        count, n, t, nn, nt = self._sums
        slope = (nt - n * t / count) / (nn - n * n / count)
        return float(slope), float((t - slope * n) / count)


def usual_gap_ns(pts_ns: Int64Array) -> float:
    """Median time from a frame to the next; 0 where no clock runs."""
    gaps_ns = np.diff(pts_ns)
    return float(np.median(gaps_ns[gaps_ns > 0])) if np.any(gaps_ns > 0) else 0.0


def frame_periods(pts_ns: Int64Array, number: Int64Array, usual_ns: float) -> int:
    """Count the frame periods from the first frame to the last.

    A frame that never came counts all the same: by the jump in frame numbers, or, in a file whose
    frames are only counted, by an interval that is twice as long as usual.

    Parameters
    ----------
    pts_ns, number : ndarray, shape (frames,)
        Time and number of each frame.
    usual_ns : float
        Time that most frames take; 0 is unknown.
    """
    if RegularClock.fit(number, pts_ns / NS_PER_S) is not None:
        return int(number[-1] - number[0])  # long intervals are but late stamps
    jumps = np.diff(number)
    by_time = np.rint(np.diff(pts_ns) / usual_ns) if usual_ns else jumps
    return int(np.maximum(jumps, by_time).sum())


class FrameClock:
    """Counts frame periods and the time they take, over all of a stream."""

    def __init__(self) -> None:
        self._first_ns: int | None = None  # a stream's clock may begin below zero
        # Frames since those whose periods were counted, with the last of these.
        self._pts_ns, self._number = np.empty((2, 0), np.int64)
        self._usual_ns = 0.0
        self._periods = 0

    def add(self, block: RowBlock) -> None:
        """Take the times of a block's frames."""
        if self._first_ns is None:
            self._first_ns = int(block.frame_pts_ns[0])
        self._pts_ns = np.concatenate([self._pts_ns, block.frame_pts_ns])
        self._number = np.concatenate([self._number, block.frame_number])
        self._usual_ns = self._usual_ns or usual_gap_ns(self._pts_ns)
        if self._pts_ns.size > COUNTED_FRAMES:
            self._periods += self._waiting
            self._pts_ns, self._number = self._pts_ns[-1:], self._number[-1:]

    @property
    def _waiting(self) -> int:
        """Periods of the frames that aren't counted yet."""
        return frame_periods(self._pts_ns, self._number, self._usual_ns)

    @property
    def span_s(self) -> float:
        """Time from the first frame to the last."""
        if self._first_ns is None:
            return 0.0
        return (int(self._pts_ns[-1]) - self._first_ns) / NS_PER_S

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second; NaN before there are two."""
        periods = self._periods + self._waiting
        return periods / self.span_s if self.span_s > 0 else float("nan")
