"""Slow time: when frames were taken, and a buffer of values, one a frame, with their times.

:class:`SlowTime` corrects times for stamps that aren't even (:mod:`rsenf.flicker.regular_clock`),
for slips and for conversions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from rsenf.flicker.frame_slips import FrameSlip
from rsenf.flicker.rate_conversion import Conversion
from rsenf.flicker.regular_clock import RegularClock
from rsenf.messages import RowBlock
from rsenf.messages.schema import Int64Array
from rsenf.timebase import NS_PER_S

Float = NDArray[np.float64]
Int = NDArray[np.int64]

COUNTED_FRAMES = 32  # whose periods are counted together
HOLE_FRAMES = 0.5  # difference of time and numbers, from bin to bin, at missing frames
MOST_STRETCHES = 0.2  # per bin: gaps are few
MOST_CORRELATED = 0.98  # correlation of neighbouring bins' times


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


def frame_rate(t_s: Float, numbers: Float) -> tuple[float, float]:
    """Frame rate and its standard error, from parallel lines through stretches without gaps.

    Sources don't number frames that they never received: across a gap time advances, but numbers
    don't.

    Parameters
    ----------
    t_s, numbers : ndarray, shape (bins,)
        Mean time and mean frame number of each bin.
    """
    step_s, step = np.diff(t_s), np.diff(numbers)
    usual_hz = float(np.median(step / step_s))
    holes = np.abs(step - usual_hz * step_s) > HOLE_FRAMES
    stretch = np.concatenate([[0], np.cumsum(holes)])
    count = np.bincount(stretch)
    t, n = (x - (np.bincount(stretch, x) / count)[stretch] for x in (t_s, numbers))
    square = float(t @ t)
    if not square > 0.0:
        return usual_hz, np.inf
    rate_hz = float(t @ n) / square
    residual = n - rate_hz * t
    var = float(residual @ residual) / max(t.size - count.size - 1, 1)
    if var > HOLE_FRAMES**2 or count.size > MOST_STRETCHES * t.size:
        return rate_hz, np.inf  # the rate varies
    # With a slowly varying rate residuals are correlated (AR(1)): fewer effective samples.
    alike = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-30)
    alike = min(max(alike, 0.0), MOST_CORRELATED)
    return rate_hz, float(np.sqrt(var / square * (1.0 + alike) / (1.0 - alike)))


class FrameCounter:
    """Counts frame periods, and the time they take, over a whole stream."""

    def __init__(self) -> None:
        self._first_ns: int | None = None  # a stream's clock may begin below zero
        # Frames not yet counted, preceded by the last counted one.
        self._pts_ns, self._number = np.empty((2, 0), np.int64)
        self._usual_ns, self._periods = 0.0, 0

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


class SlowTime:
    """Slow-time values of several lines, with frame times, numbers and usability.

    Values are appended block by block and dropped from the front; storage doubles when needed and
    never shrinks below one window.

    Parameters
    ----------
    lines : int
    origin_ns : int
        Stream clock at the first frame.
    dtype : data type
        Of the values: complex, or real.

    Attributes
    ----------
    slips : list of FrameSlip
        Lost and repeated frames that were corrected, in the order of their detection.
    conversion : Conversion, optional
        How the stream was converted from another frame rate.
    """

    def __init__(self, lines: int, origin_ns: int, dtype: npt.DTypeLike = np.complex128) -> None:
        self.origin_ns = origin_ns
        self._start, self._stop, self._slipped_s = 0, 0, 0.0  # and the sum of all slips
        self.slips: list[FrameSlip] = []
        self.conversion: Conversion | None = None
        self._t_s, self._stamp_s, self._late_s = np.empty((3, 1024))
        self._number = np.empty(1024, np.int64)
        self._usable, self._unfiltered = np.empty((2, 1024), bool)
        self._value = np.empty((1024, lines), dtype)

    def append(self, block: RowBlock, value: NDArray[Any]) -> None:
        """Append the values of a block's frames, shape (frames, lines)."""
        self._make_room(block.frames)
        new = slice(self._stop, self._stop + block.frames)
        self._stamp_s[new] = (block.frame_pts_ns - self.origin_ns) / NS_PER_S
        self._late_s[new] = self._slipped_s
        self._t_s[new] = self._stamp_s[new] + self._slipped_s
        self._number[new] = block.frame_number
        self._usable[new], self._unfiltered[new] = block.usable, bool(block.effort)
        self._value[new] = value
        self._stop = new.stop
        if self.conversion is not None:
            self._undo(self.conversion, new)

    def _make_room(self, frames: int) -> None:
        if self._stop + frames <= self._t_s.size:
            return
        kept = self._stop - self._start
        size = max(self._t_s.size, 2 * (kept + frames))
        for name in ("_t_s", "_stamp_s", "_late_s", "_number", "_usable", "_unfiltered", "_value"):
            old = getattr(self, name)
            new = np.empty((size, *old.shape[1:]), old.dtype)
            new[:kept] = old[self._start : self._stop]
            setattr(self, name, new)
        self._start, self._stop = 0, kept

    @property
    def last_t_s(self) -> float:
        """Time of the last frame since the first."""
        return float(self._t_s[self._stop - 1]) if self._stop > self._start else -np.inf

    @property
    def first_t_s(self) -> float:
        """Time of the first frame in the buffer; infinite without any."""
        return float(self._t_s[self._start]) if self._stop > self._start else np.inf

    def between(self, start_s: float, end_s: float) -> slice:
        """Slice for the accessors below, of the frames with ``start_s ≤ t < end_s``."""
        t = self._t_s[self._start : self._stop]
        a, b = (self._start + int(t.searchsorted(t_s)) for t_s in (start_s, end_s))
        return slice(a, b)

    def forget_before(self, t_s: float) -> None:
        """Drop the frames before a time."""
        self._start = self.between(-np.inf, t_s).stop

    def slip(self, slip: FrameSlip, period_s: float) -> None:
        """Correct the frame times for lost or repeated frames.

        Parameters
        ----------
        slip : FrameSlip
        period_s : float
            Frame period.
        """
        self.slips.append(slip)
        step_s = period_s if slip.frames > 0 else -period_s
        for k in range(abs(slip.frames)):
            # Repeated frames are each as old as the one before.
            first = slip.frame_number + (k if slip.frames < 0 else 0)
            stored = slice(self._start, self._stop)
            later = slice(self._start + int(self._number[stored].searchsorted(first)), self._stop)
            self._slipped_s += step_s
            self._late_s[later] += step_s
            self._t_s[later] = self._stamp_s[later] + self._late_s[later]

    def times(self, part: slice) -> NDArray[np.float64]:
        """Seconds since the first frame, by time stamps and corrected slips."""
        return self._t_s[part]

    def values(self, part: slice) -> NDArray[Any]:
        """Slow-time values, shape (frames, lines)."""
        return self._value[part]

    def usable(self, part: slice) -> NDArray[np.bool_]:
        """Whether each frame's rows are usable."""
        return self._usable[part]

    def unfiltered(self, part: slice) -> bool:
        """Whether any of the frames was decoded without the codec's loop filter."""
        return bool(np.any(self._unfiltered[part]))

    def numbers(self, part: slice) -> NDArray[np.int64]:
        """Number of each frame."""
        return self._number[part].copy()

    def usable_of(self, start_s: float, end_s: float) -> tuple[NDArray[np.float64], NDArray[Any]]:
        """Times and values of the usable frames of a time span."""
        part = self.between(start_s, end_s)
        usable = self._usable[part]
        return self._t_s[part][usable], self._value[part][usable]

    def usable_ratio(self, part: slice) -> float:
        """Share of the frames whose rows are usable."""
        return float(np.mean(self._usable[part])) if part.stop > part.start else 0.0

    def convert(self, conversion: Conversion) -> None:
        """Use the times at which the camera took the frames, and each camera frame once."""
        self.conversion = conversion
        self._undo(conversion, slice(self._start, self._stop))

    def go_by(self, clock: RegularClock) -> None:
        """Replace the time stamps of all frames so far by a regular clock's."""
        stored = slice(self._start, self._stop)
        self._stamp_s[stored] = clock.times(self._number[stored], self._stamp_s[stored])
        self._t_s[stored] = self._stamp_s[stored] + self._late_s[stored]

    def _undo(self, conversion: Conversion, part: slice) -> None:
        stamp_s = self._stamp_s[part]
        frame = np.floor(conversion.source_frames(stamp_s))
        before = conversion.source_frames(stamp_s - 1.0 / conversion.shown_hz)
        self._usable[part] &= (frame > np.floor(before)) & ~conversion.unsure(stamp_s)
        self._stamp_s[part] = frame / conversion.source_hz
        self._t_s[part] = self._stamp_s[part] + self._late_s[part]

    def period_s(self, part: slice) -> float:
        """Frame period by time stamps; missing frames count as well."""
        if self.conversion is not None:
            return 1.0 / self.conversion.source_hz
        t, n = self._stamp_s[part], self._number[part]
        return float((t[-1] - t[0]) / (n[-1] - n[0]))

    def frame_numbers(self, part: slice) -> tuple[int, int]:
        """First and last frame, inclusive; -1 for none."""
        if part.stop == part.start:
            return -1, -1
        return int(self._number[part.start]), int(self._number[part.stop - 1])

    def frame_rate_hz(self, part: slice) -> float:
        """Frame rate by exact times; missing frames count by their numbers."""
        if part.stop - part.start < 2:
            return float("nan")
        t, n = self._t_s[part], self._number[part]
        return float((n[-1] - n[0]) / (t[-1] - t[0]))
