"""Sums of a luma plane over tiles: the only pass over the pixels.

The plane is cut across the read-out axis into a few tiles; every row (the sampling unit of the
paper, Section III-B) gets one sum per tile. Strips, row means and the steady mask are computed
from these sums, so that the mask needs no second pass.
"""

from __future__ import annotations

import functools
import itertools

import cv2
import numpy as np
from numpy.typing import NDArray

# OpenCV's threads would compete with the decoder's for the same cores, and these sums are limited
# by memory bandwidth.
cv2.setNumThreads(1)

# Arguments of cv2.reduce: exact integer sums. Looked up once, since a tile takes only 3 µs.
SUM, INT32 = cv2.REDUCE_SUM, cv2.CV_32S

# Size of a part that is read twice: it fits the processor's cache.
CACHED_BYTES = 1 << 19

Int32Array = NDArray[np.int32]


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
