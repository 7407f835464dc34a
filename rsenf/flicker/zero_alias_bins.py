"""Averages a stream's rows in time bins, whose number is bounded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.zero_alias_rows import Float

BIN_S = 0.25
MOST_BINS = 480  # even, since they merge in pairs


class RowBins:
    """Sums of rows in equal time bins, merged in pairs when there are too many.

    Two minutes in quarter seconds, four in half seconds, and so on. Frames are added one after
    the other, so that their division into blocks changes nothing.

    Parameters
    ----------
    start_s : float
        Start of the first bin.
    bin_s : float, optional
        Initial length of a bin.

    Examples
    --------
    >>> bins = RowBins(0.0)
    >>> bins.add(np.array([0.0, 0.2, 0.3]), np.array([2.0, 4.0, 5.0])[:, None, None])
    >>> level, t_s, frames = bins.means()
    >>> level[:, 0, 0].tolist(), frames.tolist()
    ([3.0, 5.0], [2.0, 1.0])
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
            # One allocation: untouched pages cost nothing, and it is freed as a whole.
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
        """Number of bins with frames."""
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
