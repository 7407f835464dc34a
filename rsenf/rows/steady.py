"""Which parts of the picture are steady: a background model on tile means.

The paper takes row means over *steady* pixels, those that motion doesn't touch. A pixel-wise
background subtraction costs more than decoding, so the decision is made on cells, one tile wide
and a band of rows high. Flicker changes all cells of a band by the same factor at the same time;
motion changes single cells. So: divide each frame's cells by the band's common factor, compare
with the background, and call a cell moving when it leaves the background by more than it usually
does.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.medians import median_of_few
from rsenf.messages.schema import Float32Array

BAND_ROWS = 16
# Background and spread follow the scene within some 20 blocks (5 s at 30 fps); where something
# moves four times slower, so that it isn't taken for background while it passes.
LEARNING_RATE = 0.05
MOVING_SLOWDOWN = 4.0
# A cell is moving when it leaves the background by this many times its usual spread, and by more
# than a level: codec noise alone moves a cell's mean by tenths of a level.
SPREADS = 6.0
MIN_DEVIATION_LEVEL = 1.0
# A cell that is never quiet (leaves, a fan) is not steady either.
RESTLESS_LEVEL = 6.0


class SteadyMask:
    """Background, spread and decision, one block of frames at a time.

    Rows are the last axis of everything: neighbours in memory, so that each step is one long loop.

    Parameters
    ----------
    tiles, rows : int
        Size of the tile means.
    """

    def __init__(self, tiles: int, rows: int) -> None:
        self.bands = max(1, rows // BAND_ROWS)
        self.band_starts = np.arange(self.bands + 1) * rows // self.bands
        self._band_rows = np.diff(self.band_starts)
        self._rows_in_band = self._band_rows.astype(np.float32)
        self.shape = (tiles, rows)
        self._background: Float32Array | None = None
        self._spread = np.full((tiles, self.bands), MIN_DEVIATION_LEVEL / SPREADS, np.float32)

    @property
    def background(self) -> Float32Array:
        """Background level of every tile and row, shape (tiles, rows)."""
        if self._background is None:
            raise ValueError("no block has been seen yet")
        return self._background

    def band_means(self, level: Float32Array) -> Float32Array:
        """Average over bands of rows: (…, rows) to (…, bands)."""
        sums = np.add.reduceat(level, self.band_starts[:-1], axis=-1)
        return np.asarray(np.divide(sums, self._rows_in_band, out=sums))

    def rows_of(self, of_bands: NDArray[Any]) -> NDArray[Any]:
        """Write out to every row: (…, bands) to (…, rows)."""
        return np.repeat(of_bands, self._band_rows, axis=-1)

    def update(self, level: Float32Array) -> NDArray[np.bool_]:
        """Learn from a block and tell which cells stayed steady throughout it.

        Parameters
        ----------
        level : ndarray of float32, shape (frames, tiles, rows)
            Mean luma of each row in each tile.

        Returns
        -------
        ndarray of bool, shape (tiles, bands)
        """
        first = self._background is None
        if self._background is None:
            self._background = np.asarray(np.median(level, axis=0), np.float32)
        background = self.band_means(self._background)
        gain, deviation = self._deviation(self.band_means(level), background)
        worst = np.abs(deviation).max(axis=0)
        usual = np.maximum(MIN_DEVIATION_LEVEL, SPREADS * self._spread)
        steady = np.asarray((worst <= usual) & (self._spread <= RESTLESS_LEVEL))
        self._learn(level / self.rows_of(gain)[:, None], deviation, steady, first)
        return steady

    @staticmethod
    def _deviation(
        cells: Float32Array, background: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        """Return the common factor of each band, (frames, bands), and what is left of each cell."""
        floor = np.maximum(background, 1.0)
        gain = np.maximum(median_of_few((cells / floor).transpose(0, 2, 1)), 1e-3)
        return gain, cells - gain[:, None] * floor

    def _learn(
        self,
        flat: Float32Array,
        deviation: Float32Array,
        steady: NDArray[np.bool_],
        first: bool,
    ) -> None:
        # The spread is learnt only where nothing moves, or motion would soon count as usual.
        spread = np.sqrt(_mean_of_frames(deviation**2))
        weight = 1.0 if first else np.where(steady, LEARNING_RATE, 0.0)
        self._spread = np.asarray(self._spread + weight * (spread - self._spread), np.float32)
        rate = np.where(steady, LEARNING_RATE, LEARNING_RATE / MOVING_SLOWDOWN)
        learnt = self.rows_of(rate)
        learnt *= _mean_of_frames(flat) - self.background
        learnt += self.background
        self._background = learnt.astype(np.float32)


def _mean_of_frames(of: Float32Array) -> Float32Array:
    """Average over the first axis, without all that ``np.mean`` looks at before it does."""
    return np.asarray(np.add.reduce(of, axis=0) / len(of))
