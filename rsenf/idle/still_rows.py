"""Rows of a stream's first minutes, averaged over time, and the flicker that stands still in them.

They are kept only until they have been told apart for good: both take most of what an estimator
needs where flicker stands still, of memory and of time.
"""

from __future__ import annotations

from rsenf.flicker.cell_light import Light, cell_means, still_light_of
from rsenf.flicker.zero_alias import MIN_BINS, ZeroAlias, separate
from rsenf.flicker.zero_alias_bins import RowBins
from rsenf.messages.schema import Float32Array, FloatArray

SHORTEST_S = 8.0
# Longer bins would blur what the grid's deviation turns.
LONGEST_S = 240.0


class StillRows:
    """Bins of rows, and what was found in them.

    Parameters
    ----------
    start_s : float
        Where the first bin begins.

    Attributes
    ----------
    span_s : float
        Time that they cover.
    light : Light, optional
        What their cells show of the flicker last told apart.
    """

    def __init__(self, start_s: float) -> None:
        self.span_s = 0.0
        self._start_s = start_s
        self._bins: RowBins | None = RowBins(start_s)  # none once nothing more can come of them
        self._found: ZeroAlias | None = None
        self.light: Light | None = None
        self._looked = self._full = False

    def add(self, t_s: FloatArray, level: Float32Array, end_s: float) -> None:
        """Add frames, unless they are too late.

        Parameters
        ----------
        t_s : ndarray, shape (frames,)
        level : ndarray, shape (frames, rows, strips)
        end_s : float
            How far the stream has come.
        """
        self._full = self._full or end_s - self._start_s >= LONGEST_S
        if self._bins is None or self._full:
            return
        self._bins.add(t_s, level)
        self.span_s, self._looked = end_s - self._start_s, False

    @property
    def enough(self) -> bool:
        """Whether they can be told apart: not those of a short stream, or one of great gaps."""
        return self._bins is None or (self.span_s >= SHORTEST_S and self._bins.count >= MIN_BINS)

    @property
    def show_flicker(self) -> bool:
        """Whether flicker was told apart from the texture in them."""
        found = self.told_apart() if self.enough else None
        return found is not None and found.is_flicker

    def told_apart(self) -> ZeroAlias | None:
        """Tell flicker and texture apart, where there is enough of them; None without flicker."""
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
