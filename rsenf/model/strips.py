"""Strips of a line, and positions along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def strip_edges(pixels: int, strips: int) -> NDArray[np.int64]:
    """Pixels where strips begin, and the end of the last: (strips + 1,).

    >>> strip_edges(1280, 4).tolist()
    [0, 320, 640, 960, 1280]
    """
    return np.round(np.linspace(0, pixels, strips + 1)).astype(np.int64)


def places(pixels: int) -> NDArray[np.float32]:
    """Position of each pixel's middle along its line, from −½ to ½."""
    return ((np.arange(pixels) + 0.5) / pixels - 0.5).astype(np.float32)
