"""Cached access to a long reference on disk, by pages (least recently used dropped).

A search reads the same few hundred places of a reference again and again.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import cast

import numpy as np

from rsenf.match.series import Grid
from rsenf.messages.schema import FloatArray

PAGE = 1 << 10  # samples
KEPT = 1 << 11  # pages, 16 MB


class Pages:
    """Slices of a series, read page by page.

    Parameters
    ----------
    samples : array_like
        With ``size`` and slicing.
    """

    def __init__(self, samples: FloatArray) -> None:
        self.size = samples.size

        @lru_cache(maxsize=KEPT)
        def page(number: int) -> FloatArray:
            return np.asarray(samples[number * PAGE : (number + 1) * PAGE], np.float64)

        self._page = page

    def __getitem__(self, part: slice) -> FloatArray:
        """Return the samples from ``start`` up to ``stop``."""
        numbers = range(part.start // PAGE, -(-part.stop // PAGE))
        first = numbers.start * PAGE
        whole = np.concatenate([self._page(number) for number in numbers])
        return whole[part.start - first : part.stop - first]


def in_pages(grid: Grid) -> Grid:
    """Return a reference with a page cache; one in memory is returned as it is."""
    if isinstance(grid.freq_hz, np.ndarray):
        return grid
    return replace(grid, freq_hz=cast("FloatArray", Pages(grid.freq_hz)))
