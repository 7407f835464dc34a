"""Strips of a line, and places along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def strip_edges(pixels: int, strips: int) -> NDArray[np.int64]:
    """Pixels where strips begin, and the end of the last: (strips + 1,)."""
    return np.round(np.linspace(0, pixels, strips + 1)).astype(np.int64)


def places(pixels: int) -> NDArray[np.float32]:
    """Where the middle of each pixel is, −½ to ½ along its line."""
    return ((np.arange(pixels) + 0.5) / pixels - 0.5).astype(np.float32)
