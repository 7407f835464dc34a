"""Frame clock: the camera's frame rate despite missing frames and jittering time stamps.

A free-running sensor begins its frames at even times; a driver or a network stamps them when they
arrive. Jitter of 4 ms turns the phase of 100 Hz light by 2.5 rad, and the tone is lost. A straight
line through the stamps over the frame numbers restores it. What remains is the error of its slope,
a scale error that all frequencies share.
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

MIN_FRAMES = 16  # with fewer, a missing frame and jitter look alike
COUNTED_FRAMES = 32  # whose periods are counted together
MIN_JITTER_S = 5e-4  # rms; less turns the light's phase by a third of a radian at most
MOST_OFF = 0.5  # frame periods; a stamp farther off the line means a missing frame
MOST_ALIKE = 0.5  # lag-1 autocorrelation of the residuals; above it the rate varies


class RegularClock:
    """Line through time stamps over frame numbers (ordinary least squares, running sums).

    Frame times stay on the line known when the clock was made, since a new line would move results
    that are already out. ``rate_ratio`` is the correction of frequencies that this requires.

    Parameters
    ----------
    number : ndarray of int64, shape (frames,)
    stamp_s : ndarray, shape (frames,)
        Time stamps since the stream's first frame.
    """

    def __init__(self, number: Int, stamp_s: Float) -> None:
        self._first, self._missing = int(number[0]), 0
        self._sums = np.zeros(5)  # of 1, n, t, n², n·t
        self._residual_power = 0.0
        place = (number - self._first).astype(np.float64)
        self._add(place, stamp_s)
        self._period_s, self._begin_s = self._line()
        residual = stamp_s - self._begin_s - self._period_s * place
        self._residual_power = float(residual @ residual)
        self.jitter_s = float(np.sqrt(self._residual_power / residual.size))
        self.most_off = float(np.abs(residual).max()) / self._period_s
        self.alike = float(residual[1:] @ residual[:-1]) / max(self._residual_power, 1e-30)

    @classmethod
    def fit(cls, number: Int, stamp_s: Float) -> Self | None:
        """Fit a clock to jittering stamps; None if they don't jitter, or frames aren't even."""
        if number.size < MIN_FRAMES or not number[-1] > number[0]:
            return None
        clock = cls(number, stamp_s)
        jitters = clock.jitter_s > MIN_JITTER_S and clock.alike < MOST_ALIKE
        return clock if jitters and clock.most_off < MOST_OFF else None

    @property
    def frame_rate_hz(self) -> float:
        """Frame rate at which the clock was made."""
        return 1.0 / self._period_s

    @property
    def rate_ratio(self) -> tuple[float, float]:
        """Frame rate by all stamps so far over the clock's, and its standard error."""
        count, n, _, nn, _ = self._sums
        period_s, _ = self._line()
        variance = self._residual_power / max(count - 2.0, 1.0) / (nn - n * n / count)
        return self._period_s / period_s, float(np.sqrt(variance)) / period_s

    def times(self, number: Int) -> Float:
        """Times at which frames were taken since the first, shape (frames,)."""
        place = number - self._first + self._missing
        return np.asarray(self._begin_s + self._period_s * place)

    def regular(self, block: RowBlock, origin_ns: int) -> RowBlock:
        """Return a block with even frame times, and add its stamps to the fit."""
        stamp_s = (block.frame_pts_ns - origin_ns) / NS_PER_S
        place = (block.frame_number - self._first + self._missing).astype(np.float64)
        period_s, begin_s = self._line()
        residual = stamp_s - begin_s - period_s * place
        # A gap that frame numbers don't show: all later frames are late by whole periods.
        if late := round(float(np.median(residual)) / period_s):
            self._missing += late
            place, residual = place + late, residual - late * period_s
        self._add(place, stamp_s)
        self._residual_power += float(residual @ residual)
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
    """Median time from a frame to the next; 0 if the clock stands still."""
    gaps_ns = np.diff(pts_ns)
    return float(np.median(gaps_ns[gaps_ns > 0])) if np.any(gaps_ns > 0) else 0.0


def frame_periods(pts_ns: Int64Array, number: Int64Array, usual_ns: float) -> int:
    """Count the frame periods from the first frame to the last, missing frames included.

    A frame that never came shows as a jump in frame numbers or, where the numbers only count the
    frames received, as an interval about twice as long as usual.

    Parameters
    ----------
    pts_ns, number : ndarray, shape (frames,)
        Time and number of each frame.
    usual_ns : float
        Usual time between frames; 0 if unknown.

    Examples
    --------
    >>> frame_periods(np.array([0, 40, 120]) * 10**6, np.array([0, 1, 2]), 40e6)
    3
    """
    if RegularClock.fit(number, pts_ns / NS_PER_S) is not None:
        return int(number[-1] - number[0])  # long intervals are jitter
    jumps = np.diff(number)
    by_time = np.rint(np.diff(pts_ns) / usual_ns) if usual_ns else jumps
    return int(np.maximum(jumps, by_time).sum())


class FrameClock:
    """Counts frame periods, and the time they take, over a whole stream."""

    def __init__(self) -> None:
        self._first_ns: int | None = None  # a stream's clock may begin below zero
        # Frames not yet counted, preceded by the last counted one.
        self._pts_ns, self._number = np.empty((2, 0), np.int64)
        self._usual_ns = 0.0
        self._periods = 0

    def add(self, block: RowBlock) -> None:
        """Add the times of a block's frames."""
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
        """Periods of the frames not yet counted."""
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
