"""Bounded buffer of slow-time values (one a frame) of the last seconds, with exact frame times."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from rsenf.flicker.frame_clock import RegularClock
from rsenf.flicker.frame_slips import FrameSlip
from rsenf.flicker.rate_conversion import Conversion
from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S


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
        self._start, self._stop = 0, 0
        self.slips: list[FrameSlip] = []
        self.conversion: Conversion | None = None
        self._slipped_s = 0.0  # sum of all slips
        self._t_s, self._stamp_s, self._late_s = np.empty((3, 1024))
        self._number = np.empty(1024, np.int64)
        self._usable = np.empty(1024, bool)
        self._value = np.empty((1024, lines), dtype)

    def append(self, block: RowBlock, value: NDArray[Any]) -> None:
        """Append the values of a block's frames, shape (frames, lines)."""
        self._make_room(block.frames)
        new = slice(self._stop, self._stop + block.frames)
        self._stamp_s[new] = (block.frame_pts_ns - self.origin_ns) / NS_PER_S
        self._late_s[new] = self._slipped_s
        self._t_s[new] = self._stamp_s[new] + self._slipped_s
        self._number[new] = block.frame_number
        self._usable[new] = block.usable
        self._value[new] = value
        self._stop = new.stop
        if self.conversion is not None:
            self._undo(self.conversion, new)

    def _make_room(self, frames: int) -> None:
        if self._stop + frames <= self._t_s.size:
            return
        kept = self._stop - self._start
        size = max(self._t_s.size, 2 * (kept + frames))
        for name in ("_t_s", "_stamp_s", "_late_s", "_number", "_usable", "_value"):
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
        self._stamp_s[stored] = clock.times(self._number[stored])
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
