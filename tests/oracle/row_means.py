"""Row means the slow, obvious way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def row_means(luma: NDArray[np.uint8], axis: str, strips: int) -> NDArray[np.float64]:
    """Mean luma of every row and strip, one pixel after the other in exact integers."""
    plane = luma if axis == "rows" else luma.T
    rows, across = plane.shape
    # Strips are made of eight tiles, cut as evenly as can be.
    edges = [round(i * across / 8) for i in range(0, 9, 8 // strips)]
    out = np.empty((rows, strips))
    for r in range(rows):
        for s in range(strips):
            pixels = [int(v) for v in plane[r, edges[s] : edges[s + 1]]]
            out[r, s] = sum(pixels) / len(pixels)
    return out
