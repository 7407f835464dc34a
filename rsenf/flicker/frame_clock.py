"""The camera's frame rate, whatever frames are missing from its stream."""

from __future__ import annotations

import numpy as np

from rsenf.messages import RowBlock
from rsenf.messages.schema import Int64Array
from rsenf.timebase import NS_PER_S


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
    jumps = np.diff(number)
    by_time = np.rint(np.diff(pts_ns) / usual_ns) if usual_ns else jumps
    return int(np.maximum(jumps, by_time).sum())


class FrameClock:
    """Counts frame periods and the time they take, over all of a stream."""

    def __init__(self) -> None:
        self._first_ns: int | None = None  # a stream's clock may begin below zero
        self._last_ns, self._last_number = 0, 0
        self._usual_ns = 0.0
        self._periods = 0

    def add(self, block: RowBlock) -> None:
        """Take the times of a block's frames."""
        pts, number = block.frame_pts_ns, block.frame_number
        if self._first_ns is None:
            self._first_ns = self._last_ns = int(pts[0])
            self._last_number = int(number[0])
        pts = np.concatenate([[self._last_ns], pts])
        number = np.concatenate([[self._last_number], number])
        self._usual_ns = self._usual_ns or usual_gap_ns(pts)
        self._periods += frame_periods(pts, number, self._usual_ns)
        self._last_ns, self._last_number = int(pts[-1]), int(number[-1])

    @property
    def span_s(self) -> float:
        """Time from the first frame to the last."""
        return 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) / NS_PER_S

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second; NaN before there are two."""
        return self._periods / self.span_s if self.span_s > 0 else float("nan")
