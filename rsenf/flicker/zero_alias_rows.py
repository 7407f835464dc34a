"""Logarithms of row means, in which texture, gain and flicker add instead of multiplying."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Bands of rows: more than two per turn of the eighth harmonic at six turns a frame.
BANDS = 120
FIELD_BANDS = 24  # bands in which even and odd rows are compared
DARK = 1.0  # darker rows (levels) are ignored, since their logarithm is mostly noise


@dataclass(frozen=True, eq=False)
class RowLogs:
    """Logarithms of row means, without texture and gain.

    Parameters
    ----------
    value : ndarray, shape (bins, rows)
        Doubly centred: each bin's mean over rows, and each row's over time, are 0.
    t_s : ndarray, shape (bins,)
        Times of the bins.
    weight : ndarray, shape (bins,)
        Of the bins; 1 on average.
    row_weight : ndarray, shape (rows,)
        Of the rows; 1 on average.
    place : ndarray, shape (rows,)
        Middle of each row, 0 to 1 down the frame.
    """

    value: Float
    t_s: Float
    weight: Float
    row_weight: Float
    place: Float

    def centred(self, part: Float) -> Float:
        """Return an array of shape (…, bins, rows) less texture and gain."""
        out = self.without_gain(part)
        out -= self._texture(out)
        return out

    def without_gain(self, part: Float) -> Float:
        """Subtract each bin's weighted mean over rows."""
        return np.asarray(part - (part @ self.row_weight / self.place.size)[..., None])

    def without_texture(self, part: Float) -> Float:
        """Subtract each row's weighted mean over time."""
        return np.asarray(part - self._texture(part))

    def _texture(self, part: Float) -> Float:
        return np.asarray((self.weight @ part / self.weight.sum())[..., None, :])

    def weighted(self, part: Float) -> Float:
        """Multiply by the weights of bins and rows."""
        out = np.asarray(part * self.row_weight)
        out *= self.weight[:, None]
        return out

    def power(self, part: Float) -> float:
        """Weighted sum of squares."""
        return float(np.vdot(part, self.weighted(part)))

    def freedom(self, spent: int) -> int:
        """Degrees of freedom left after estimating ``spent`` parameters."""
        bins, rows = self.value.shape
        return int(max((bins - 1) * (rows - 1) - spent, 1))


def row_logs(level: Float, t_s: Float, weight: Float) -> RowLogs:
    """Take logarithms of row means, average them in bands, and centre them.

    The noise of a logarithm is inversely proportional to the level: bands are weighted by its
    square.

    Parameters
    ----------
    level : ndarray, shape (bins, rows)
        Mean levels.
    t_s, weight : ndarray, shape (bins,)
        Times, and number of frames that each bin averages.
    """
    rows = level.shape[1]
    edges = np.unique(np.round(np.linspace(0, rows, min(rows, BANDS) + 1)).astype(int))
    height = np.diff(edges)
    logs = np.add.reduceat(np.log(np.maximum(level, DARK)), edges[:-1], axis=1) / height
    mean = np.average(logs, axis=0, weights=weight)
    row_weight = height * np.where(mean > np.log(DARK), np.exp(2.0 * mean), 0.0)
    row_weight /= max(row_weight.mean(), np.finfo(float).tiny)
    place = (edges[:-1] + edges[1:]) / (2.0 * rows)
    raw = RowLogs(logs, t_s, weight / weight.mean(), row_weight, place)
    return replace(raw, value=raw.centred(logs))


def field_bands(profile: Float) -> Float:
    """Levels of even rows, and even less odd rows, in bands side by side.

    Parameters
    ----------
    profile : ndarray, shape (frames, rows)

    Returns
    -------
    ndarray, shape (frames, 2 * FIELD_BANDS)
    """
    pairs = profile[:, : profile.shape[1] // 2 * 2].reshape(len(profile), -1, 2)
    edges = np.linspace(0, pairs.shape[1], FIELD_BANDS, endpoint=False).astype(int)
    level, less = pairs[:, :, 0], pairs[:, :, 0] - pairs[:, :, 1]
    return np.hstack([np.add.reduceat(level, edges, 1), np.add.reduceat(less, edges, 1)])


def are_opposed(rows: Float, fields: Float) -> bool:
    """Whether even and odd rows differ by more slow variation than they have in common.

    Parameters
    ----------
    rows : ndarray, shape (bins, rows)
        Levels.
    fields : ndarray, shape (bins, 2 * FIELD_BANDS)
        As of :func:`field_bands`.
    """
    level, less = np.split(fields, 2, axis=1)
    logs = np.log(np.maximum(rows, 1.0))
    apart = less / np.maximum(level, 1.0)
    return _slow_power(apart) > _slow_power(logs - logs.mean(axis=1, keepdims=True))


def _slow_power(series: Float) -> float:
    """Variance over time less that of the noise, from differences of neighbouring bins."""
    return float(np.mean(np.var(series, axis=0)) - np.mean(np.diff(series, axis=0) ** 2) / 2.0)
