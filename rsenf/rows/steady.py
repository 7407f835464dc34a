"""Which parts of the picture are steady: a background model on tile means.

The paper takes row means over *steady* pixels, those that motion doesn't touch. A pixel-wise
background subtraction costs more than decoding, so the decision is made on cells, one tile wide
and a band of rows high, block by block of frames. Flicker changes all cells of a band by the same
factor at the same time; motion changes single cells. So: divide each frame's cells by the band's
common factor, see by how much each is off its background, and call a cell moving while that
changes by more than it usually does.

What stands still again is of use again, whatever it shows now: it gets a new background, and a
factor that brings it to the level of the old one, so that who comes and goes leaves no steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.medians import median_of_few
from rsenf.messages.schema import Float32Array

# In this many blocks an offset goes back to nothing, or nearly (1/e); and then it is nothing.
FADES_BLOCKS, NOTHING_LEVEL = 10.0, 0.01
BAND_ROWS = 16
# The spread follows the scene within some 20 blocks (5 s at 30 fps), the background within two.
LEARNING_RATE, FOLLOW_RATE = 0.05, 0.5
# A cell is moving when it leaves a straight line by this many times its usual spread, and by more
# than a level: codec noise alone moves a cell's mean by tenths of a level.
SPREADS = 6.0
MIN_DEVIATION_LEVEL = 1.0
# What changes slowly is no flicker, and leaves the rows no steps: so much in a block may be.
SLOW_LEVEL = 4.0
LAST_FRAMES = 2  # of the block before, that show what changes between the two
# A cell that is never quiet (leaves, a fan) is not steady either.
RESTLESS_LEVEL = 6.0
# Cells that moved in the block before count by so little in the common factor.
DOUBTED = 0.1
NEAR = 0.1  # and those by little that are off by as much more than this, of the factor before


class Levelling:
    """Offsets of tiles and rows, that fade slowly, with no step from frame to frame.

    Offsets, not factors: these would make dark parts' noise as bright as what stood there.
    """

    def __init__(self) -> None:
        self._offset: Float32Array | None = None  # (tiles, rows), at the end of the block before

    def replace(self, before: Float32Array, now: Float32Array) -> None:
        """Bring what has another background now to the level of before: both (tiles, rows)."""
        self._offset = (0.0 if self._offset is None else self._offset) + before - now

    def of_block(self, frames: int) -> Float32Array | None:
        """Return the next frames' offsets, (frames, tiles, rows); None where there are none."""
        offset = self._offset
        if offset is None:
            return None
        fade = np.exp(-np.arange(1, frames + 1, dtype=np.float32) / (frames * FADES_BLOCKS))
        self._offset = fade[-1] * offset if np.abs(offset).max() > NOTHING_LEVEL else None
        return np.asarray(fade[:, None, None] * offset)


class SteadyMask:
    """Background, spread and decision, one block of frames at a time.

    Rows are the last axis of everything: neighbours in memory, so that each step is one long loop.

    Parameters
    ----------
    tiles, rows : int
        Size of the tile means.

    Attributes
    ----------
    levelling : Levelling
        Brings what stands there now to the level of what stood there before.
    """

    def __init__(self, tiles: int, rows: int) -> None:
        self.bands = max(1, rows // BAND_ROWS)
        self.band_starts = np.arange(self.bands + 1) * rows // self.bands
        self._band_rows = np.diff(self.band_starts)
        self._rows_in_band = self._band_rows.astype(np.float32)
        self.shape = (tiles, rows)
        self.levelling = Levelling()
        self._background: Float32Array | None = None
        self._spread = np.full((tiles, self.bands), MIN_DEVIATION_LEVEL / SPREADS, np.float32)
        # Of the block before: its last cells and common factors, and the decision.
        self._cells = np.empty((0, tiles, self.bands), np.float32)
        self._gain = np.empty((0, self.bands), np.float32)
        self._steady = np.ones((tiles, self.bands), np.bool_)

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
        cells = self.band_means(level)
        floor = np.maximum(self.band_means(self._background), 1.0)
        gain = self._common_factor(cells, floor)
        seen, light = (np.concatenate(x) for x in ((self._cells, cells), (self._gain, gain)))
        bright = _mean_of_frames(gain)
        quick, rise = _beside_line(seen * (bright / light)[:, None])
        usual = np.maximum(MIN_DEVIATION_LEVEL, SPREADS * self._spread)
        quiet = (np.abs(quick).max(axis=0) <= usual) & (self._spread <= RESTLESS_LEVEL)
        steady = np.asarray(quiet & (np.abs(rise) <= SLOW_LEVEL))
        self._learn_spread(quick, steady, first)
        flat = _mean_of_frames(level / self.rows_of(gain)[:, None])
        self._learn_background(flat, steady, bright)
        self._cells, self._gain, self._steady = cells[-LAST_FRAMES:], gain[-LAST_FRAMES:], steady
        return steady

    def _common_factor(self, cells: Float32Array, floor: Float32Array) -> Float32Array:
        """Brightness of each band over its background's, (frames, bands)."""
        ratio = (cells / floor).transpose(0, 2, 1)
        gain = np.asarray(np.maximum(median_of_few(ratio), 1e-3))
        off = np.abs(cells - gain[:, None] * floor)
        if not self._gain.size or (self._steady.all() and off.max() <= MIN_DEVIATION_LEVEL):
            return gain
        # Where much moves the most common factor may be a coat's: it is where it was before.
        usual = _mean_of_frames(self._gain)[:, None]
        trust = np.where(self._steady, 1.0, DOUBTED).T / (1.0 + ((ratio / usual - 1.0) / NEAR) ** 2)
        gain = np.asarray(np.maximum(_weighted_median(ratio, trust), 1e-3))
        lost = ~self._steady.any(axis=0)  # nothing tells how bright the light is now
        gain[:, lost] *= usual[lost, 0] / _mean_of_frames(gain)[lost]
        return gain

    def _learn_spread(self, quick: Float32Array, steady: NDArray[np.bool_], first: bool) -> None:
        # Learnt only where nothing moves, or motion would soon count as usual.
        spread = np.sqrt(_mean_of_frames(quick**2))
        weight = 1.0 if first else np.where(steady | (spread < self._spread), LEARNING_RATE, 0.0)
        self._spread = np.asarray(self._spread + weight * (spread - self._spread), np.float32)

    def _learn_background(
        self, flat: Float32Array, steady: NDArray[np.bool_], bright: Float32Array
    ) -> None:
        before, back = self.background, steady & ~self._steady
        rate = np.where(back, 1.0, np.where(steady, FOLLOW_RATE, 0.0)).astype(np.float32)
        self._background = before + self.rows_of(rate) * (flat - before)
        if back.any():
            shown = self.rows_of(back * bright)
            self.levelling.replace(before * shown, self._background * shown)


def _weighted_median(values: Float32Array, weight: NDArray[np.floating]) -> Float32Array:
    """Median over the last axis of values that count by weights."""
    order = np.argsort(values, axis=-1)
    reached = np.cumsum(np.take_along_axis(weight, order, -1), -1)
    middle = np.argmax(reached >= reached[..., -1:] / 2.0, axis=-1)[..., None]
    return np.take_along_axis(values, np.take_along_axis(order, middle, -1), -1)[..., 0]


def _beside_line(course: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return what a straight line over the frames leaves of each cell, and the line's rise."""
    place = np.arange(len(course), dtype=np.float32) / max(len(course) - 1, 1)
    place -= place.mean()
    line = place[:, None, None]
    rise = np.add.reduce(line * course, axis=0) / max(np.add.reduce(place**2), 1e-9)
    return course - _mean_of_frames(course) - line * rise, np.asarray(rise)


def _mean_of_frames(of: Float32Array) -> Float32Array:
    """Average over the first axis, without all that ``np.mean`` looks at before it does."""
    return np.asarray(np.add.reduce(of, axis=0) / len(of))
