"""Sums of a luma plane over tiles: the one pass over the pixels that everything else rests on.

The plane is cut across the read-out axis into a few tiles; every row (the paper's Section III-A
unit of sampling) gets one sum per tile. Strips, row means and the steady mask are all made from
these sums, so the mask costs no second pass over the picture.
"""

from __future__ import annotations

import functools
import itertools

import cv2
import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import Float32Array

# Threads inside OpenCV fight the decoder's for the same cores, and these sums are limited by
# memory, not by arithmetic.
cv2.setNumThreads(1)

# Rows that are read again are read while they are in the processor's own cache.
CACHED_BYTES = 1 << 19

Int32Array = NDArray[np.int32]


@functools.cache
def tile_edges(width_px: int, tiles: int) -> tuple[int, ...]:
    """Return the ``tiles + 1`` column indices that cut ``width_px`` as evenly as can be."""
    return tuple(round(i * width_px / tiles) for i in range(tiles + 1))


def tile_sums(luma: NDArray[np.uint8], axis: str, tiles: int) -> Float32Array:
    """Sum the luma of every row over each tile.

    Parameters
    ----------
    luma : ndarray of uint8, shape (height_px, width_px)
        Luma plane; lines may be padded (any stride along the rows).
    axis : {'rows', 'columns'}
        Direction in which the sensor is read out: 'rows' top to bottom.
    tiles : int
        Tiles across that axis.

    Returns
    -------
    ndarray of float32, shape (rows, tiles)
        Exact: a tile would have to be 65 000 pixels wide to exceed float32's integers.
    """
    height_px, width_px = luma.shape
    if axis == "columns":
        edges = itertools.pairwise(tile_edges(height_px, tiles))
        sums = np.concatenate([_sums(luma[a:b], 0) for a, b in edges]).T
    elif tiles == 1 or (width_px % tiles == 0 and luma.flags.c_contiguous):
        sums = _sums(luma.reshape(height_px * tiles, -1), 1).reshape(height_px, tiles)
    else:
        at_once = max(CACHED_BYTES // luma.strides[0], 1)
        bands = range(0, height_px, at_once)
        sums = np.concatenate([_uneven(luma[top : top + at_once], tiles) for top in bands])
    return sums.astype(np.float32, order="C")


def tile_pixels(
    height_px: int, width_px: int, axis: str, tiles: int
) -> tuple[int, NDArray[np.int64]]:
    """Return the number of rows along the read-out axis, and the pixels a row has in each tile."""
    rows, across = (width_px, height_px) if axis == "columns" else (height_px, width_px)
    edges = np.array(tile_edges(across, tiles), np.int64)
    return rows, edges[1:] - edges[:-1]


def _uneven(band: NDArray[np.uint8], tiles: int) -> Int32Array:
    """Sum each row of some over tiles that memory isn't cut by, shape (rows, tiles).

    Reading a tile skips the rest of each row, at which memory is several times slower. So whole
    rows come first, and the last tile is what the others leave of them.
    """
    whole = _sums(band, 1)
    edges = itertools.pairwise(tile_edges(band.shape[1], tiles)[:-1])
    parts = [_sums(band[:, a:b], 1) for a, b in edges]
    return np.concatenate([*parts, whole - sum(parts)], axis=1)


def _sums(part: NDArray[np.uint8], dim: int) -> Int32Array:
    """Sum along a dimension, exactly; it stays, with a length of 1."""
    return np.asarray(cv2.reduce(part, dim, cv2.REDUCE_SUM, dtype=cv2.CV_32S))
