"""Rows of a stream's first minutes, averaged over time, and flicker with its alias at 0 Hz in them.

They are kept only until flicker and texture are separated for good: both take most of the memory
and time that an estimator needs at such an alias.
"""

from __future__ import annotations

from rsenf.flicker.cell_light import Light, cell_means, still_light_of
from rsenf.flicker.zero_alias import MIN_BINS, ZeroAlias, separate
from rsenf.flicker.zero_alias_bins import RowBins
from rsenf.messages.schema import Float32Array, FloatArray

SHORTEST_S = 8.0
# Longer bins would blur the phase that the grid's deviation turns.
LONGEST_S = 240.0


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
                seen, bands = cells.reshape(len(cells), -1), cells.shape[1]
                self.light = still_light_of(seen, t_s, phase_rad, bands, turns)
        if self._full:
            self._bins = None
        return self._found
