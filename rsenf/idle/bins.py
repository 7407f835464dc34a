"""Mean rows of short times: what is kept for flicker that stands still from frame to frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S

Float = NDArray[np.float64]

# The grid's deviation turns the flicker by a fraction of a radian in this time.
BIN_S = 0.4
MOST_BINS = 480


class Bins:
    """Mean levels of rows and strips over equal times, up to a number of them.

    Parameters
    ----------
    first : RowBlock
        The stream's first block.
    """

    def __init__(self, first: RowBlock) -> None:
        self._origin_ns = int(first.frame_pts_ns[0])
        self._shape = (first.rows, first.strips)
        self._bin: list[int] = []
        self._frames: list[int] = []
        self._time_s: list[float] = []
        self._level: list[Float] = []

    def __len__(self) -> int:
        return len(self._bin)

    def add(self, block: RowBlock) -> None:
        """Add the frames of a block; those after the last bin are left out."""
        if block.level.shape[1:] != self._shape:
            return
        t_s = (block.frame_pts_ns - self._origin_ns) / NS_PER_S
        for t, k, level in zip(t_s.tolist(), (t_s // BIN_S).astype(int), block.level, strict=True):
            if not self._bin or k != self._bin[-1]:
                if len(self) == MOST_BINS:
                    return
                self._bin.append(k)
                self._frames.append(0)
                self._time_s.append(0.0)
                self._level.append(np.zeros(self._shape))
            self._frames[-1] += 1
            self._time_s[-1] += t
            self._level[-1] += level

    def means(self) -> tuple[Float, Float, Float]:
        """Levels (bins, rows, strips), mean times in seconds (bins,), and frames (bins,)."""
        frames = np.array(self._frames, np.float64)
        level = np.array(self._level) / frames[:, None, None]
        return level, np.array(self._time_s) / frames, frames
