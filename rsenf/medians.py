"""Medians of a few numbers each, many at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def median_of_few(values: NDArray[np.floating]) -> NDArray[Any]:
    """Median over the last axis, the same as ``np.median``: of so few, sorting is the faster."""
    count = values.shape[-1]
    ordered = np.array(values, order="C")  # neighbours in memory are the faster to sort
    ordered.sort(axis=-1)
    return np.asarray((ordered[..., (count - 1) // 2] + ordered[..., count // 2]) / 2.0)
