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

# Threads inside OpenCV fight the decoder's for the same cores, and these sums are limited by
# memory, not by arithmetic.
cv2.setNumThreads(1)

# What OpenCV's reduce is told: to add up, exactly. Looked up once: a tile takes it 3 µs.
SUM, INT32 = cv2.REDUCE_SUM, cv2.CV_32S

# Rows that are read again are read while they are in the processor's own cache.
CACHED_BYTES = 1 << 19

Int32Array = NDArray[np.int32]


@functools.cache
def tile_edges(width_px: int, tiles: int) -> tuple[int, ...]:
    """Return the ``tiles + 1`` column indices that cut ``width_px`` as evenly as can be."""
    return tuple(round(i * width_px / tiles) for i in range(tiles + 1))


def tile_sums(luma: NDArray[np.uint8], axis: str, tiles: int) -> Int32Array:
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
    ndarray of int32, shape (tiles, rows)
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
        by_row = np.asarray(cells).reshape(height_px, tiles)
        return by_row.T if tiles == 1 else np.asarray(cv2.transpose(by_row))
    sums = np.empty((tiles, height_px, 1), np.int32)
    at_once = max(CACHED_BYTES // luma.strides[0], 1)
    for top in range(0, height_px, at_once):
        _uneven(luma[top : top + at_once], sums[:, top : top + at_once])
    return sums[:, :, 0]


def tile_pixels(
    height_px: int, width_px: int, axis: str, tiles: int
) -> tuple[int, NDArray[np.int64]]:
    """Return the number of rows along the read-out axis, and the pixels a row has in each tile."""
    rows, across = (width_px, height_px) if axis == "columns" else (height_px, width_px)
    edges = np.array(tile_edges(across, tiles), np.int64)
    return rows, edges[1:] - edges[:-1]


def _uneven(band: NDArray[np.uint8], sums: Int32Array) -> None:
    """Sum each row of some over tiles that memory isn't cut by: ``sums``, shape (tiles, rows, 1).

    Reading a tile skips the rest of each row, at which memory is several times slower. So whole
    rows come first, only to be in the cache when their tiles are read.
    """
    cv2.reduce(band, 1, SUM, sums[0], INT32)
    for tile, of_tile in zip(_tiles(band.shape[1], len(sums)), sums, strict=True):
        cv2.reduce(band[tile], 1, SUM, of_tile, INT32)


@functools.cache
def _tiles(width_px: int, tiles: int) -> tuple[tuple[slice, slice], ...]:
    """Where each tile is in a plane, for its index."""
    edges = itertools.pairwise(tile_edges(width_px, tiles))
    return tuple((slice(None), slice(a, b)) for a, b in edges)
