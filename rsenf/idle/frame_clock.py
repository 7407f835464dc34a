"""The frame rate over all of a stream, whatever frames are missing from it."""

from __future__ import annotations

import numpy as np

from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S


class FrameClock:
    """Counts frame periods and the time they take.

    A frame that never came counts all the same: by the jump in frame numbers, or, in a file whose
    frames are only counted, by an interval that is twice as long as usual.
    """

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
        if not self._usual_ns:
            gaps = np.diff(pts, prepend=self._last_ns)
            self._usual_ns = float(np.median(gaps[gaps > 0])) if np.any(gaps > 0) else 0.0
        for pts_ns, frame in zip(pts.tolist(), number.tolist(), strict=True):
            gap_ns, jump = pts_ns - self._last_ns, frame - self._last_number
            by_time = round(gap_ns / self._usual_ns) if self._usual_ns else jump
            self._periods += max(jump, by_time)
            self._last_ns, self._last_number = pts_ns, frame

    @property
    def span_s(self) -> float:
        """Time from the first frame to the last."""
        return 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) / NS_PER_S

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second; NaN before there are two."""
        return self._periods / self.span_s if self.span_s > 0 else float("nan")
