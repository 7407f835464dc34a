"""A long series on disk in pages, of which those looked at last are kept.

A search looks at the same few hundred places of a reference again and again, ever more closely.
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
    """Slices of a series, read by the page.

    Parameters
    ----------
    samples : array_like
        That tells its ``size`` and gives slices.
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
    """Return a reference that keeps what was looked at; one in memory is as it should be."""
    if isinstance(grid.freq_hz, np.ndarray):
        return grid
    return replace(grid, freq_hz=cast("FloatArray", Pages(grid.freq_hz)))
