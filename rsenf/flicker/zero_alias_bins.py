"""Rows of a stream averaged in bins of time: as many as are needed, and never more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.zero_alias_rows import Float

BIN_S = 0.25
MOST_BINS = 480  # an even number: they merge in pairs


class RowBins:
    """Sums of rows in equal bins of time, merged in pairs when there are too many.

    Two minutes in quarter seconds, four in half seconds, and so on. Frames are added one after
    the other, so how they come in blocks changes nothing.

    Parameters
    ----------
    start_s : float
        Where the first bin begins.
    bin_s : float, optional
        Length of a bin, to begin with.
    """

    def __init__(self, start_s: float, bin_s: float = BIN_S) -> None:
        self.start_s, self.bin_s = start_s, bin_s
        self._t_s, self._frames = np.zeros(MOST_BINS), np.zeros(MOST_BINS)
        self._level: Float = np.empty((0, 0, 0))

    def add(self, t_s: Float, level: NDArray[np.floating]) -> None:
        """Add frames.

        Parameters
        ----------
        t_s : ndarray, shape (frames,)
            Times of the frames, none before the start.
        level : ndarray, shape (frames, rows, strips)
            Mean levels of their rows.
        """
        if not self._level.size:
            # All in one piece: what isn't reached yet costs nothing, and all of it goes back.
            self._level = np.zeros((MOST_BINS, *level.shape[1:]))
        for t, rows in zip(t_s.tolist(), level, strict=True):
            while (k := max(int((t - self.start_s) // self.bin_s), 0)) >= MOST_BINS:
                self._merge()
            self._level[k] += rows
            self._t_s[k] += t
            self._frames[k] += 1.0

    def _merge(self) -> None:
        self.bin_s *= 2.0
        for of in (self._level, self._t_s, self._frames):
            half = MOST_BINS // 2
            of[:half] = of[::2] + of[1::2]
            of[half:] = 0.0

    @property
    def count(self) -> int:
        """How many bins have frames."""
        return int(np.count_nonzero(self._frames))

    def means(self) -> tuple[Float, Float, Float]:
        """Mean levels (bins, rows, strips), mean times (bins,) and numbers of frames (bins,).

        Bins without frames are left out.
        """
        there = np.flatnonzero(self._frames)
        frames = self._frames[there]
        level = self._level[there]
        level /= frames[:, None, None]
        return level, self._t_s[there] / frames, frames
