"""Clocks of even frame times, for stamps that aren't even.

A free-running sensor begins its frames at even times; a driver or a network stamps them when they
arrive. Jitter of 4 ms turns the phase of 100 Hz light by 2.5 rad, and the tone is lost. A straight
line through the stamps over the frame numbers restores it, but for the error of its slope, a scale
error that all frequencies share.

A container may round the stamps: Matroska, WebM, FLV and ASF to 1 ms, some QuickTime files to
1/600 s. At 24, 30 and 60 frames/s the rounding repeats every three frames. So does 100 Hz light at
30 and 60 frames/s: a tone at a third of the frame rate, of which the rounding makes an image. Even
times that the stamps are rounded from are exact.
"""

from __future__ import annotations

import dataclasses
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S

Float = NDArray[np.float64]
Int = NDArray[np.int64]

MIN_FRAMES = 16  # with fewer, a missing frame and jitter look alike
MIN_JITTER_S = 5e-4  # rms; less turns the light's phase by a third of a radian at most
MOST_OFF = 0.5  # frame periods; a stamp farther off the line means a missing frame
MOST_ALIKE = 0.5  # lag-1 autocorrelation of the residuals; above it the rate varies
# Rounded stamps: range of the unit (s; larger ones are the frames of another rate); how exact gaps
# are multiples of it (s); and the memory of the line, in frames.
UNIT_S, EXACT_S, MEMORY_FRAMES = (1e-4, 2e-3), 2e-6, 9e3


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

    def times(self, number: Int, stamp_s: Float) -> Float:
        """Times at which frames were taken since the first, shape (frames,)."""
        place = number - self._first + self._missing
        return np.asarray(self._begin_s + self._period_s * place)

    def regular(self, block: RowBlock, origin_ns: int) -> RowBlock:
        """Return a block with even frame times, and add its stamps to the fit."""
        stamp_s = (block.frame_pts_ns - origin_ns) / NS_PER_S
        self._learn(block.frame_number, stamp_s)
        even_s = self.times(block.frame_number, stamp_s)
        pts_ns = origin_ns + np.rint(even_s * NS_PER_S).astype(np.int64)
        return dataclasses.replace(block, frame_pts_ns=pts_ns)

    def _learn(self, number: Int, stamp_s: Float) -> None:
        """Add stamps to the fit."""
        place = (number - self._first + self._missing).astype(np.float64)
        period_s, begin_s = self._line()
        residual = stamp_s - begin_s - period_s * place
        # A gap that frame numbers don't show: all later frames are late by whole periods.
        if late := round(float(np.median(residual)) / period_s):
            self._missing += late
            place, residual = place + late, residual - late * period_s
        self._add(place, stamp_s)
        self._residual_power += float(residual @ residual)

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


class RoundedClock(RegularClock):
    """Line through stamps that are even times rounded to a coarse unit.

    Frames are counted by their stamps: some may be missing. The present line follows a slow drift;
    where the rate changes, stamps are farther than a unit off it, and times as far off as they are.

    Parameters
    ----------
    place : ndarray of int64, shape (frames,)
        Frame periods since the first frame.
    stamp_s : ndarray, shape (frames,)
    unit_s : float
        What the stamps are multiples of.
    """

    def __init__(self, place: Int, stamp_s: Float, unit_s: float) -> None:
        super().__init__(place, stamp_s)
        self._unit_s = unit_s
        self.jitter_s = 0.0  # of the times that replace the stamps

    @classmethod
    def of_stamps(cls, stamp_s: Float) -> Self | None:
        """Fit a clock to rounded stamps; None if they aren't, or frames aren't even.

        The gaps between rounded even times have two values, one unit apart.

        Examples
        --------
        >>> stamp_s = np.rint(np.arange(60) / 30 * 1e3) / 1e3
        >>> clock = RoundedClock.of_stamps(stamp_s)
        >>> bool(np.abs(clock.times(np.arange(60), stamp_s) * 30 - np.arange(60)).max() < 1e-3)
        True
        >>> RoundedClock.of_stamps(np.arange(60) / 30) is None
        True
        """
        gap_s = np.diff(stamp_s)
        usual_s = float(np.median(gap_s)) if gap_s.size >= MIN_FRAMES else 0.0
        single_s = gap_s[np.abs(gap_s - usual_s) < MOST_OFF * usual_s]
        if 2 * single_s.size < gap_s.size or not usual_s > 0.0:
            return None
        middle_s = (single_s.min() + single_s.max()) / 2
        short_s, long_s = single_s[single_s <= middle_s], single_s[single_s > middle_s]
        if not long_s.size or max(np.ptp(short_s), np.ptp(long_s)) > EXACT_S:
            return None
        unit_s = float(long_s[0] - short_s[0])
        if not UNIT_S[0] < unit_s < UNIT_S[1]:
            return None
        periods = np.rint(gap_s / single_s.mean()).astype(np.int64)
        clock = cls(np.append(0, np.cumsum(periods)), stamp_s, unit_s)
        return clock if clock.most_off * clock._period_s < unit_s else None

    def times(self, number: Int, stamp_s: Float) -> Float:
        """Times at which frames were taken since the first, shape (frames,)."""
        place, off_s = self._placed(stamp_s)
        off_s[np.abs(off_s) < self._unit_s] = 0.0
        return np.asarray(self._begin_s + self._period_s * place + off_s)

    def _learn(self, number: Int, stamp_s: Float) -> None:
        place, off_s = self._placed(stamp_s)
        is_even = np.abs(off_s) < self._unit_s
        self._sums *= np.exp(-np.count_nonzero(is_even) / MEMORY_FRAMES)
        self._add(place[is_even], stamp_s[is_even])

    def _placed(self, stamp_s: Float) -> tuple[Float, Float]:
        """Places by the present line, and how far the stamps are off it."""
        period_s, begin_s = self._line()
        place = np.rint((stamp_s - begin_s) / period_s)
        return place, stamp_s - begin_s - period_s * place
