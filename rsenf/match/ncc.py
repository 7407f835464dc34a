"""Normalised cross-correlation at every lag, with holes on both sides, by FFT.

At lag ``l`` the value ``x[i]`` meets ``y[i + l]``; a pair counts where both are valid. The six
masked sums over the pairs (how many, Σx, Σy, Σx², Σy², Σxy) are cross-correlations of the zero
filled series and their masks, after Padfield, "Masked object registration in the Fourier domain",
IEEE Trans. Image Processing 21(5), 2012. The long series is taken in overlapping stretches
(overlap-save), so that a year costs no more memory than a day but for its results.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import FloatArray

BoolArray = NDArray[np.bool_]

MIN_FFT = 1 << 16  # measured: a quarter of the time of 2^20, which falls out of the cache
ROUNDING = 1e-11  # of the series' own variance: below it a variance is rounding, not signal


@dataclass(frozen=True, eq=False)
class LagTable:
    """What two series say about each other at consecutive lags; NaN where too few pairs do.

    ``first_lag`` belongs to entry 0. All arrays have one entry a lag: ``pairs`` counts,
    ``correlation`` is Pearson's coefficient over the pairs, ``offset`` the mean of ``x − y``
    (unit of the series), ``residual_var`` the variance of ``x − y`` about that offset.
    """

    first_lag: int
    pairs: NDArray[np.int64]
    correlation: FloatArray
    offset: FloatArray
    residual_var: FloatArray

    @property
    def lags(self) -> NDArray[np.int64]:
        """Lag of each entry, in samples."""
        return np.arange(self.first_lag, self.first_lag + self.pairs.size)


class _Sums(NamedTuple):
    pairs: FloatArray
    x: FloatArray
    y: FloatArray
    xx: FloatArray
    yy: FloatArray
    xy: FloatArray


def masked_ncc(
    x: FloatArray, x_ok: BoolArray, y: FloatArray, y_ok: BoolArray, *, min_pairs: int = 3
) -> LagTable:
    """Compare ``x`` with ``y`` at every lag at which they overlap.

    Parameters
    ----------
    x, y : ndarray of float, shapes (n,) and (N,)
        The short and the long series, on one step.
    x_ok, y_ok : ndarray of bool, shapes (n,) and (N,)
        Where they are valid; what they hold elsewhere doesn't matter.
    min_pairs : int
        Lags with fewer valid pairs are NaN.

    Returns
    -------
    LagTable
        For lags ``−(n − 1)`` to ``N − 1``.
    """
    tables = list(lag_tables(x, x_ok, y, y_ok, min_pairs=min_pairs))
    return LagTable(
        tables[0].first_lag,
        np.concatenate([t.pairs for t in tables]),
        np.concatenate([t.correlation for t in tables]),
        np.concatenate([t.offset for t in tables]),
        np.concatenate([t.residual_var for t in tables]),
    )


def lag_tables(
    x: FloatArray, x_ok: BoolArray, y: FloatArray, y_ok: BoolArray, *, min_pairs: int = 3
) -> Iterator[LagTable]:
    """Yield the table of :func:`masked_ncc` in stretches of lags, in bounded memory."""
    from scipy import fft

    x0, y0 = _mean(x, x_ok), _mean(y, y_ok)
    scale_x, scale_y = _variance(x, x_ok), _variance(y, y_ok)
    size = fft.next_fast_len(max(MIN_FFT, 4 * x.size), real=True)
    lags = size - x.size + 1
    x_spectra = [np.conj(fft.rfft(part, size)) for part in _powers(x, x_ok, x0)]
    for first in range(1 - x.size, y.size, lags):
        part = slice(max(first, 0), min(first + size, y.size))
        before = part.start - first
        y_spectra = [
            fft.rfft(np.pad(p, (before, size - before - p.size)))
            for p in _powers(y[part], y_ok[part], y0)
        ]
        count = min(lags, y.size - first)
        # Orders of (x, y): pairs, Σx, Σy, Σx², Σy², Σxy.
        orders = ((0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1))
        sums = _Sums(
            *(fft.irfft(x_spectra[i] * y_spectra[j], size)[:count] for i, j in orders),
        )
        yield _table(first, sums, x0 - y0, (scale_x, scale_y), min_pairs)


def _powers(v: FloatArray, ok: BoolArray, mean: float) -> tuple[FloatArray, ...]:
    """Return the zeroth, first and second power about the mean, zero where not valid."""
    centred = np.where(ok, v - mean, 0.0)
    return ok.astype(np.float64), centred, centred * centred


def _mean(v: FloatArray, ok: BoolArray) -> float:
    return float(v[ok].mean()) if ok.any() else 0.0


def _variance(v: FloatArray, ok: BoolArray) -> float:
    return float(v[ok].var()) if ok.any() else 0.0


def _table(
    first: int, sums: _Sums, offset: float, scale: tuple[float, float], min_pairs: int
) -> LagTable:
    pairs = np.rint(sums.pairs).astype(np.int64)
    enough = pairs >= max(min_pairs, 1)
    n = np.where(enough, pairs, 1)
    mean_x, mean_y = sums.x / n, sums.y / n
    var_x = np.maximum(sums.xx / n - mean_x**2, 0.0)
    var_y = np.maximum(sums.yy / n - mean_y**2, 0.0)
    cov = sums.xy / n - mean_x * mean_y
    varies = (var_x > ROUNDING * scale[0]) & (var_y > ROUNDING * scale[1])
    product = np.where(varies, var_x * var_y, 1.0)
    correlation = np.clip(cov / np.sqrt(product), -1.0, 1.0)
    return LagTable(
        first,
        pairs,
        np.where(enough & varies, correlation, np.nan),
        np.where(enough, offset + mean_x - mean_y, np.nan),
        np.where(enough, np.maximum(var_x + var_y - 2 * cov, 0.0), np.nan),
    )


class Comparison(NamedTuple):
    """The same at one lag, computed directly."""

    pairs: int
    correlation: float
    offset: float
    residual_var: float


def compare_at(
    x: FloatArray, x_ok: BoolArray, y: FloatArray, y_ok: BoolArray, lag: int
) -> Comparison:
    """Compare at one lag by plain sums: exact where :func:`masked_ncc` rounds.

    Lags without a pair give NaN.
    """
    a, b = max(0, -lag), min(x.size, y.size - lag)
    if a >= b:
        return Comparison(0, np.nan, np.nan, np.nan)
    both = x_ok[a:b] & y_ok[a + lag : b + lag]
    xs, ys = x[a:b][both], y[a + lag : b + lag][both]
    if xs.size == 0:
        return Comparison(0, np.nan, np.nan, np.nan)
    difference = xs - ys
    dx, dy = xs - xs.mean(), ys - ys.mean()
    power_x, power_y = float(dx @ dx), float(dy @ dy)
    # A constant stretch leaves its mean's rounding behind, about 1e-16 of its level.
    varies = power_x > 1e-24 * float(xs @ xs) and power_y > 1e-24 * float(ys @ ys)
    correlation = float(dx @ dy) / (power_x * power_y) ** 0.5 if varies else np.nan
    return Comparison(xs.size, correlation, float(difference.mean()), float(difference.var()))
