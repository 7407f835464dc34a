"""Detects the steady parts of the picture, by background subtraction on tile means.

The paper takes row means over *steady* pixels, those not touched by motion (Section III-B).
Subtraction per pixel costs more than decoding. So the only pass over the pixels sums each row over
a few tiles, cut across the read-out axis; strips, row means and the steady mask come from these
sums. The mask decides on cells, one tile wide and a band of rows high, for each block of frames.

Model: flicker multiplies all cells of a band by a common factor (their median ratio to the
background), motion changes single cells. Statistic: a cell over the common factor, minus a straight
line over the block's frames. A cell is moving when it exceeds a multiple of its usual spread, when
its line rises by more than ``SLOW_LEVEL``, or when its spread is always large.

A cell that is still again is used again, whatever it shows now: it gets a new background, and an
offset, fading slowly, to the level of the old one. So passing objects leave no steps.
"""

from __future__ import annotations

import functools
import itertools
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rsenf.medians import median_of_few
from rsenf.messages.schema import Float32Array

# OpenCV's threads would compete with the decoder's for the same cores, and these sums are limited
# by memory bandwidth.
cv2.setNumThreads(1)

# Arguments of cv2.reduce: exact integer sums. Looked up once, since a tile takes only 3 µs.
SUM, INT32 = cv2.REDUCE_SUM, cv2.CV_32S

# Size of a part that is read twice: it fits the processor's cache.
CACHED_BYTES = 1 << 19

Int32Array = NDArray[np.int32]


# Bars: range of levels along the outermost lines; by how much the mean of a line of the picture
# differs; fewest lines, and largest difference of the two bars; and how many lines inside the
# picture which share of the pixels differs by more than twice that.
BAR_RANGE, BAR_OFF, BAR_LINES, BARS_APART, EDGE_LINES, EDGE_SHARE = 2, 3.0, 4, 2, 2, 0.5
BLUR_LINES = 8


def picture_part(luma: NDArray[Any]) -> tuple[slice, slice]:
    """Return the rows and columns between the bars that fill a picture of another shape.

    Bars have one level, without noise, to their outermost lines; they are as wide on both sides and
    end in a straight edge. So the dark border of a scene isn't one.

    Examples
    --------
    >>> picture_part(np.pad(np.full((20, 30), 90), [(6, 6), (0, 0)], constant_values=16))
    (slice(6, 26, None), slice(0, 30, None))
    """
    return _between_bars(luma), _between_bars(luma.T)


def _between_bars(luma: NDArray[Any]) -> slice:
    """Return the lines of the first axis between bars."""
    lines, bar = len(luma), float(luma[0, 0])
    if np.abs(luma[[0, -1]] - bar).max() <= BAR_RANGE:
        off = np.abs(luma.mean(axis=1) - bar)
        above, below = _bar_lines(off), _bar_lines(off[::-1])
        first, last = above, lines - 1 - below
        if min(above, below) >= BAR_LINES and abs(above - below) <= BARS_APART and first < last:
            edges = np.abs(luma[[first + EDGE_LINES, last - EDGE_LINES]] - bar) > 2 * BAR_OFF
            if np.all(edges.mean(axis=1) > EDGE_SHARE):
                return slice(first, last + 1)
    return slice(0, lines)


def _bar_lines(off: NDArray[np.floating]) -> int:
    """Count the lines to where the level is halfway to that of the picture: a codec blurs edges."""
    begins = int(np.argmax(off > BAR_OFF))
    inside = np.median(off[begins + EDGE_LINES :][:BLUR_LINES]) if off[begins] > BAR_OFF else np.inf
    return int(np.argmax(off > inside / 2))


@functools.cache
def tile_edges(width_px: int, tiles: int) -> tuple[int, ...]:
    """Return the ``tiles + 1`` column indices that cut a width as evenly as possible.

    >>> tile_edges(10, 4)
    (0, 2, 5, 8, 10)
    """
    return tuple(round(i * width_px / tiles) for i in range(tiles + 1))


def tile_sums(luma: NDArray[np.uint8], axis: str, tiles: int) -> Int32Array:
    """Sum the luma of every row over each tile.

    Parameters
    ----------
    luma : ndarray of uint8, shape (height_px, width_px)
        Luma plane; lines may be padded (any stride along the rows).
    axis : {'rows', 'columns'}
        Read-out axis: 'rows' is top to bottom.
    tiles : int
        Number of tiles across that axis.

    Returns
    -------
    ndarray of int32, shape (tiles, rows)

    Examples
    --------
    >>> tile_sums(np.arange(8, dtype=np.uint8).reshape(2, 4), "rows", 2)
    array([[ 1,  9],
           [ 5, 13]], dtype=int32)
    """
    height_px, width_px = luma.shape
    if axis == "columns":
        sums = np.empty((tiles, 1, width_px), np.int32)
        edges = itertools.pairwise(tile_edges(height_px, tiles))
        for (a, b), of_tile in zip(edges, sums, strict=True):
            cv2.reduce(luma[a:b], 0, SUM, of_tile, INT32)
        return sums[:, 0]
    if tiles == 1 or (width_px % tiles == 0 and luma.flags.c_contiguous):
        cells = cv2.reduce(luma.reshape(height_px * tiles, -1), 1, SUM, None, INT32)
        return np.asarray(cells).reshape(height_px, tiles).T
    sums = np.empty((tiles, height_px, 1), np.int32)
    at_once = max(CACHED_BYTES // luma.strides[0], 1)
    for top in range(0, height_px, at_once):
        _uneven(luma[top : top + at_once], sums[:, top : top + at_once])
    return sums[:, :, 0]


def tile_pixels(
    height_px: int, width_px: int, axis: str, tiles: int
) -> tuple[int, NDArray[np.int64]]:
    """Return the number of rows along the read-out axis, and a row's pixels in each tile.

    Parameters
    ----------
    height_px, width_px : int
        Size of the plane.
    axis, tiles
        As for :func:`tile_sums`.
    """
    rows, across = (width_px, height_px) if axis == "columns" else (height_px, width_px)
    edges = np.array(tile_edges(across, tiles), np.int64)
    return rows, edges[1:] - edges[:-1]


def _uneven(band: NDArray[np.uint8], sums: Int32Array) -> None:
    """Sum rows over tiles that aren't equal cuts of contiguous memory; ``sums``: (tiles, rows, 1).

    Strided access to a tile is several times slower than reading whole rows. So whole rows are
    summed first, only to load them into the cache before their tiles are read.
    """
    cv2.reduce(band, 1, SUM, sums[0], INT32)
    for tile, of_tile in zip(_tiles(band.shape[1], len(sums)), sums, strict=True):
        cv2.reduce(band[tile], 1, SUM, of_tile, INT32)


@functools.cache
def _tiles(width_px: int, tiles: int) -> tuple[tuple[slice, slice], ...]:
    """Return the index of each tile in a plane."""
    edges = itertools.pairwise(tile_edges(width_px, tiles))
    return tuple((slice(None), slice(a, b)) for a, b in edges)


# Time constant of an offset's decay (to 1/e), in blocks; below the level it is set to zero.
FADES_BLOCKS, NOTHING_LEVEL = 10.0, 0.01
BAND_ROWS = 16
# Weights of exponential smoothing: the spread follows the scene within some 20 blocks (5 s at
# 30 fps), the background within two.
LEARNING_RATE, FOLLOW_RATE = 0.05, 0.5
# A cell is moving when it departs from a straight line by more than this multiple of its spread,
# and by more than one level: codec noise alone changes a cell's mean by tenths of a level.
SPREADS = 6.0
MIN_DEVIATION_LEVEL = 1.0
# Slow changes are no flicker and leave no steps in the rows: allowed rise within a block.
SLOW_LEVEL = 4.0
LAST_FRAMES = 2  # frames of the block before that are included, to see changes between blocks
# A cell that is never quiet (leaves, a fan) is not steady either.
RESTLESS_LEVEL = 6.0
# Weight in the common factor of cells that moved in the block before.
DOUBTED = 0.1
NEAR = 0.1  # relative deviation from the factor before at which a cell's weight is halved


class Levelling:
    """Offsets of tiles and rows that decay exponentially, without steps between frames.

    Offsets rather than factors, which would amplify the noise of dark parts.
    """

    def __init__(self) -> None:
        self._offset: Float32Array | None = None  # (tiles, rows), at the end of the block before

    def replace(self, before: Float32Array, now: Float32Array) -> None:
        """Add the offset from a new background to the one before, both (tiles, rows)."""
        self._offset = (0.0 if self._offset is None else self._offset) + before - now

    def of_block(self, frames: int) -> Float32Array | None:
        """Return the offsets of the next frames, (frames, tiles, rows); None for none."""
        offset = self._offset
        if offset is None:
            return None
        fade = np.exp(-np.arange(1, frames + 1, dtype=np.float32) / (frames * FADES_BLOCKS))
        self._offset = fade[-1] * offset if np.abs(offset).max() > NOTHING_LEVEL else None
        return np.asarray(fade[:, None, None] * offset)


class SteadyMask:
    """Background, spread and decision for each cell, updated with one block of frames at a time.

    Rows are the last axis of all arrays, contiguous in memory, for long inner loops.

    Parameters
    ----------
    tiles, rows : int
        Shape of the tile means.

    Attributes
    ----------
    levelling : Levelling
        Offsets from the present background to an earlier one.
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
        # Of the block before: last cells and common factors, and the decision.
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
        """Repeat for every row of a band: (…, bands) to (…, rows)."""
        return np.repeat(of_bands, self._band_rows, axis=-1)

    def update(self, level: Float32Array) -> NDArray[np.bool_]:
        """Update the model with a block, and return which cells were steady throughout it.

        Parameters
        ----------
        level : ndarray of float32, shape (frames, tiles, rows)
            Mean luma of each row in each tile, in levels.

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
        """Return the brightness of each band over its background's, (frames, bands)."""
        ratio = (cells / floor).transpose(0, 2, 1)
        gain = np.asarray(np.maximum(median_of_few(ratio), 1e-3))
        off = np.abs(cells - gain[:, None] * floor)
        if not self._gain.size or (self._steady.all() and off.max() <= MIN_DEVIATION_LEVEL):
            return gain
        # With much motion the median may be that of a moving object (a coat, say). So weight cells
        # by how near they are to the factor of the block before.
        usual = _mean_of_frames(self._gain)[:, None]
        trust = np.where(self._steady, 1.0, DOUBTED).T / (1.0 + ((ratio / usual - 1.0) / NEAR) ** 2)
        gain = np.asarray(np.maximum(_weighted_median(ratio, trust), 1e-3))
        lost = ~self._steady.any(axis=0)  # bands without a steady cell keep their mean factor
        gain[:, lost] *= usual[lost, 0] / _mean_of_frames(gain)[lost]
        return gain

    def _learn_spread(self, quick: Float32Array, steady: NDArray[np.bool_], first: bool) -> None:
        # Updated only where nothing moves, or motion would soon count as usual spread.
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
    """Return the weighted median over the last axis."""
    order = np.argsort(values, axis=-1)
    reached = np.cumsum(np.take_along_axis(weight, order, -1), -1)
    middle = np.argmax(reached >= reached[..., -1:] / 2.0, axis=-1)[..., None]
    return np.take_along_axis(values, np.take_along_axis(order, middle, -1), -1)[..., 0]


def _beside_line(course: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return each cell minus its fitted straight line over the frames, and the line's rise."""
    place = np.arange(len(course), dtype=np.float32) / max(len(course) - 1, 1)
    place -= place.mean()
    line = place[:, None, None]
    rise = np.add.reduce(line * course, axis=0) / max(np.add.reduce(place**2), 1e-9)
    return course - _mean_of_frames(course) - line * rise, np.asarray(rise)


def _mean_of_frames(of: Float32Array) -> Float32Array:
    """Average over the first axis, without the overhead of ``np.mean``."""
    return np.asarray(np.add.reduce(of, axis=0) / len(of))
