"""Rows as logarithms, in which texture, gain and flicker add instead of multiplying."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Bands of rows: each turn of the eighth harmonic of six turns a frame still has nearly four.
BANDS = 180
DARK = 1.0  # level below which rows tell nothing, and their logarithm too much


@dataclass(frozen=True, eq=False)
class RowLogs:
    """Logarithms of row means, free of everything linear.

    Parameters
    ----------
    value : ndarray, shape (bins, rows, strips)
        Doubly centred: each bin's and strip's mean over rows, and each row's over time, are 0.
    t_s : ndarray, shape (bins,)
        Times of the bins.
    weight : ndarray, shape (bins,)
        Of the bins; 1 on average.
    row_weight : ndarray, shape (rows, strips)
        Of the rows; 1 on average in each strip.
    place : ndarray, shape (rows,)
        Middle of each row, 0 to 1 down the frame.
    """

    value: Float
    t_s: Float
    weight: Float
    row_weight: Float
    place: Float

    def centred(self, light: Float) -> Float:
        """Light on all strips alike, (bins, rows), without what texture and gain would explain."""
        return self.without_texture(self.without_gain(light[:, :, None]))

    def without_gain(self, part: Float) -> Float:
        """Take the weighted mean over rows from each bin and strip: (bins, rows, strips)."""
        mean = np.stack(
            [part[:, :, s % part.shape[2]] @ v for s, v in enumerate(self.row_weight.T)]
        )
        return np.asarray(part - mean.T[:, None, :] / self.place.size)

    def without_texture(self, part: Float) -> Float:
        """Take the weighted mean over time from each row and strip."""
        return np.asarray(part - np.tensordot(self.weight, part, 1) / self.weight.sum())

    def weighted(self, part: Float) -> Float:
        """Times the weights of bins and rows."""
        return np.asarray(part * self.row_weight * self.weight[:, None, None])

    def power(self, part: Float) -> float:
        """Weighted sum of squares."""
        return float(np.vdot(part, self.weighted(part)))

    def freedom(self, spent: int) -> int:
        """How many independent numbers are left when some have been spent."""
        bins, rows, strips = self.value.shape
        return max((bins - 1) * (rows - 1) * strips - spent, 1)


def row_logs(level: Float, t_s: Float, weight: Float) -> RowLogs:
    """Take logarithms of row means, average them in bands, and centre them.

    The noise of a logarithm goes as one over the level: bands are weighted by its square.

    Parameters
    ----------
    level : ndarray, shape (bins, rows, strips)
        Mean levels.
    t_s, weight : ndarray, shape (bins,)
        Times, and how many frames each bin is the mean of.
    """
    rows = level.shape[1]
    edges = np.unique(np.round(np.linspace(0, rows, min(rows, BANDS) + 1)).astype(int))
    height = np.diff(edges)[:, None]
    logs = np.add.reduceat(np.log(np.maximum(level, DARK)), edges[:-1], axis=1) / height
    mean = np.average(logs, axis=0, weights=weight)
    row_weight = height * np.where(mean > np.log(DARK), np.exp(2.0 * mean), 0.0)
    row_weight /= np.maximum(row_weight.mean(axis=0), np.finfo(float).tiny)
    place = (edges[:-1] + edges[1:]) / (2.0 * rows)
    raw = RowLogs(logs, t_s, weight / weight.mean(), row_weight, place)
    return replace(raw, value=raw.without_texture(raw.without_gain(logs)))
