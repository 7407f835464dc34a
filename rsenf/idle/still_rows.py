"""Rows of a stream's first minutes, averaged over time, and flicker with its alias at 0 Hz in them.

They are kept only until flicker and texture are separated for good: both take most of the memory
and time that an estimator needs at such an alias.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.cell_light import Light, cell_means, still_light_of
from rsenf.flicker.zero_alias import MIN_BINS, ZeroAlias, separate
from rsenf.flicker.zero_alias_rows import Float
from rsenf.messages.schema import Float32Array, FloatArray

SHORTEST_S = 8.0
# Longer bins would blur the phase that the grid's deviation turns.
LONGEST_S = 240.0
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


class StillRows:
    """Time bins of rows, and the flicker found in them.

    Parameters
    ----------
    start_s : float
        Start of the first bin.

    Attributes
    ----------
    span_s : float
        Time covered.
    light : Light, optional
        Statistics of the cells at the flicker last found.
    """

    def __init__(self, start_s: float) -> None:
        self.span_s = 0.0
        self._start_s = start_s
        self._bins: RowBins | None = RowBins(start_s)  # None after the final separation
        self._found: ZeroAlias | None = None
        self.light: Light | None = None
        self._looked = self._full = False

    def add(self, t_s: FloatArray, level: Float32Array, end_s: float) -> None:
        """Add frames, for the first ``LONGEST_S``.

        Parameters
        ----------
        t_s : ndarray, shape (frames,)
        level : ndarray, shape (frames, rows, strips)
        end_s : float
            Length of the stream so far.
        """
        self._full = self._full or end_s - self._start_s >= LONGEST_S
        if self._bins is None or self._full:
            return
        self._bins.add(t_s, level)
        self.span_s, self._looked = end_s - self._start_s, False

    @property
    def enough(self) -> bool:
        """Whether they suffice: not those of a short stream, or of one with large gaps."""
        return self._bins is None or (self.span_s >= SHORTEST_S and self._bins.count >= MIN_BINS)

    @property
    def show_flicker(self) -> bool:
        """Whether flicker was separated from the texture in them."""
        found = self.told_apart() if self.enough else None
        return found is not None and found.is_flicker

    def told_apart(self) -> ZeroAlias | None:
        """Separate flicker and texture; None without flicker. Cached until frames are added."""
        if self._bins is not None and not self._looked:
            level, t_s, frames = self._bins.means()
            self._found, self._looked = separate(level, t_s, frames), True
            self.light = None
            if self._found is not None:
                turns, phase_rad = abs(self._found.turns) + 1.0, self._found.phase_rad
                cells = cell_means(level)
                means, bands = cells.reshape(len(cells), -1), cells.shape[1]
                self.light = still_light_of(means, t_s, phase_rad, bands, turns)
        if self._full:
            self._bins = None
        return self._found
