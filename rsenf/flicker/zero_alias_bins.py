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
        self._level: dict[int, Float] = {}
        self._t_s: dict[int, float] = {}
        self._frames: dict[int, int] = {}

    def add(self, t_s: Float, level: NDArray[np.floating]) -> None:
        """Add frames.

        Parameters
        ----------
        t_s : ndarray, shape (frames,)
            Times of the frames, none before the start.
        level : ndarray, shape (frames, rows, strips)
            Mean levels of their rows.
        """
        for t, rows in zip(t_s.tolist(), level, strict=True):
            k = int((t - self.start_s) // self.bin_s)
            while k >= MOST_BINS:
                self._merge()
                k = int((t - self.start_s) // self.bin_s)
            self._put(k, rows, t, 1)

    def _put(self, k: int, level: NDArray[np.floating], t_s: float, frames: int) -> None:
        if k in self._frames:
            self._level[k] += level
            self._t_s[k] += t_s
            self._frames[k] += frames
        else:
            self._level[k] = level.astype(np.float64)
            self._t_s[k], self._frames[k] = t_s, frames

    def _merge(self) -> None:
        old = [(k, self._level[k], self._t_s[k], n) for k, n in self._frames.items()]
        self._level, self._t_s, self._frames = {}, {}, {}
        self.bin_s *= 2.0
        for k, level, t_s, frames in old:
            self._put(k // 2, level, t_s, frames)

    def means(self) -> tuple[Float, Float, Float]:
        """Mean levels (bins, rows, strips), mean times (bins,) and numbers of frames (bins,).

        Bins without frames are left out.
        """
        order = sorted(self._frames)
        frames = np.array([self._frames[k] for k in order], np.float64)
        level = np.stack([self._level[k] for k in order]) / frames[:, None, None]
        return level, np.array([self._t_s[k] for k in order]) / frames, frames
