"""Statistics of few values: medians, means, and the variance between estimates."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

MEDIAN_SQUARE = 0.455  # median of chi-squared with one degree of freedom


def median_of_few(values: NDArray[np.floating]) -> NDArray[Any]:
    """Return the median over the last axis, as ``np.median``; faster for few values.

    Examples
    --------
    >>> median_of_few(np.array([[3.0, 1.0, 2.0], [5.0, 9.0, 7.0]])).tolist()
    [2.0, 7.0]
    """
    count = values.shape[-1]
    ordered = np.array(values, order="C")  # contiguous values sort faster
    ordered.sort(axis=-1)
    return np.asarray((ordered[..., (count - 1) // 2] + ordered[..., count // 2]) / 2.0)


def between_var(value: NDArray[np.floating], var: NDArray[np.floating]) -> float:
    """Return the variance between estimates beyond their stated ones (DerSimonian and Laird 1986).

    Parameters
    ----------
    value, var : ndarray (estimates,)
        Estimates and their stated variances; 0 is returned for a single one.

    Examples
    --------
    >>> round(between_var(np.array([1.0, 1.2, 0.8]), np.full(3, 0.01)), 6)
    0.03
    """
    weight, more = 1.0 / var, value.size - 1
    if not more:
        return 0.0
    q = float(weight @ (value - np.average(value, weights=weight)) ** 2)
    return max((q - more) / float(weight.sum() - (weight**2).sum() / weight.sum()), 0.0)


def means(values: NDArray[np.float64], many: int) -> NDArray[np.float64]:
    """Return the means of ``many`` values each, NaN where fewer than half of them are valid.

    Examples
    --------
    >>> means(np.array([1.0, 3.0, np.nan, 5.0, np.nan, np.nan, 7.0]), 2).tolist()
    [2.0, 5.0, nan]
    """
    rows = values[: values.size // many * many].reshape(-1, many)
    # Column by column: sums of many short rows are slow.
    mean = sum((rows[:, k] for k in range(1, many)), rows[:, 0]) / many
    some = np.flatnonzero(np.isnan(mean))
    if some.size:
        ok = np.isfinite(rows[some])
        count = ok.sum(axis=1)
        total = np.where(ok, rows[some], 0.0).sum(axis=1)
        mean[some] = np.where(2 * count >= many, total / np.maximum(count, 1), np.nan)
    return mean
