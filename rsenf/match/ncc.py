"""Residuals and normalised cross-correlation at every lag, with holes on both sides, by FFT.

At lag ``l`` the value ``x[i]`` meets ``y[i + l]``; a pair counts where both are valid. All that is
asked of a lag are sums over its pairs (how many, Σx, Σy, Σx², Σy², Σxy), which are
cross-correlations of the zero filled series, their squares and their masks, after Padfield, "Masked
object registration in the Fourier domain", IEEE Trans. Image Processing 21(5), 2012. What is wanted
is added up before it is transformed back, and no mask is transformed where it has no hole. The long
series is taken in overlapping stretches (overlap-save), so that a year costs no more memory than a
day but for its results.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import FloatArray

BoolArray = NDArray[np.bool_]

MIN_FFT = 1 << 15  # measured: longer ones fall out of the cache
ROUNDING = 1e-11  # of the series' own variance: below it a variance is rounding, not signal


@dataclass(frozen=True, eq=False)
class Residuals:
    """How far apart two series are at consecutive lags; NaN where too few pairs tell.

    ``first_lag`` belongs to entry 0. All arrays have one entry a lag: ``pairs`` counts, ``offset``
    is the mean of ``x − y`` (unit of the series), ``residual_var`` the variance of ``x − y`` about
    that offset.
    """

    first_lag: int
    pairs: NDArray[np.int64]
    offset: FloatArray
    residual_var: FloatArray

    @property
    def lags(self) -> NDArray[np.int64]:
        """Lag of each entry, in samples."""
        return np.arange(self.first_lag, self.first_lag + self.pairs.size)

    def within(self, own: range) -> Residuals:
        """Leave out the lags that aren't in a range."""
        a = min(max(own.start - self.first_lag, 0), self.pairs.size)
        b = max(min(own.stop - self.first_lag, self.pairs.size), a)
        part = slice(a, b)
        return Residuals(
            self.first_lag + a, self.pairs[part], self.offset[part], self.residual_var[part]
        )


@dataclass(frozen=True, eq=False)
class LagTable(Residuals):
    """Residuals with Pearson's coefficient over the pairs, ``correlation``."""

    correlation: FloatArray


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
        np.concatenate([t.offset for t in tables]),
        np.concatenate([t.residual_var for t in tables]),
        np.concatenate([t.correlation for t in tables]),
    )


def lag_residuals(
    x: FloatArray, x_ok: BoolArray, y: FloatArray, y_ok: BoolArray, *, min_pairs: int = 3
) -> Iterator[Residuals]:
    """Yield what :func:`masked_ncc` says but for the correlation, in stretches of lags."""
    for stretch in _stretches(x, x_ok, y, y_ok):
        yield _residuals(stretch, min_pairs)


def lag_tables(
    x: FloatArray, x_ok: BoolArray, y: FloatArray, y_ok: BoolArray, *, min_pairs: int = 3
) -> Iterator[LagTable]:
    """Yield the table of :func:`masked_ncc` in stretches of lags, in bounded memory."""
    scale_x, scale_y = (float(v[ok].var()) if ok.any() else 0.0 for v, ok in ((x, x_ok), (y, y_ok)))
    for stretch in _stretches(x, x_ok, y, y_ok):
        of = _residuals(stretch, min_pairs)
        n = np.maximum(of.pairs, 1)
        mean_x = stretch.sums((1.0, 1, 0)) / n
        mean_y = stretch.sums((1.0, 0, 1)) / n
        var_x = np.maximum(stretch.sums((1.0, 2, 0)) / n - mean_x**2, 0.0)
        var_y = np.maximum(stretch.sums((1.0, 0, 2)) / n - mean_y**2, 0.0)
        cov = (var_x + var_y - of.residual_var) / 2.0
        varies = (var_x > ROUNDING * scale_x) & (var_y > ROUNDING * scale_y)
        correlation = np.clip(cov / np.sqrt(np.where(varies, var_x * var_y, 1.0)), -1.0, 1.0)
        yield LagTable(
            of.first_lag, of.pairs, of.offset, of.residual_var,
            np.where(varies, correlation, np.nan),
        )  # fmt: skip


def _residuals(stretch: _Stretch, min_pairs: int) -> Residuals:
    pairs = np.rint(stretch.sums((1.0, 0, 0)))
    n = np.where(pairs >= max(min_pairs, 1), pairs, np.nan)
    offset = stretch.sums((1.0, 1, 0), (-1.0, 0, 1)) / n
    residual_var = stretch.sums((1.0, 2, 0), (-2.0, 1, 1), (1.0, 0, 2)) / n - offset**2
    offset += stretch.reverse.level - stretch.y.level
    return Residuals(
        stretch.first,
        np.broadcast_to(pairs.astype(np.int64), stretch.count),
        offset,
        np.maximum(residual_var, 0.0),
    )


class _Powers:
    """The powers 0, 1 and 2 of a series about a level, zero where it isn't valid."""

    def __init__(self, v: FloatArray, ok: BoolArray, level: float, size: int) -> None:
        self.level, self.whole, self._size = level, bool(ok.all()), size
        centred = v - level if self.whole else np.where(ok, v - level, 0.0)
        self.of = (ok, centred, centred * centred)
        self._spectra: dict[tuple[int, float], NDArray[np.complex128]] = {}

    def spectrum(self, power: int, weight: float = 1.0) -> NDArray[np.complex128]:
        """Spectrum of a power times a weight, padded to the size of the transforms."""
        from scipy import fft

        if (power, weight) not in self._spectra:
            self._spectra[power, weight] = fft.rfft(self.of[power], self._size)
            if weight != 1.0:
                self._spectra[power, weight] *= weight
        return self._spectra[power, weight]

    def running(self, power: int, length: int) -> FloatArray:
        """Sums of a power over so many values in a row."""
        sums = np.concatenate([[0.0], np.cumsum(self.of[power])])
        return np.asarray(sums[length:] - sums[:-length], np.float64)


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Lags in a row from ``first`` on: the short series beside a part of the long one.

    ``reverse`` is the short series backwards, so that its convolution is what is wanted of it.
    """

    first: int
    count: int
    size: int
    reverse: _Powers
    y: _Powers

    def sums(self, *terms: tuple[float, int, int]) -> FloatArray:
        """Return Σ weight · x^i · y^j over the pairs of each lag, for terms (weight, i, j).

        It is of shape () where it is the same at all of them.
        """
        from scipy import fft

        x, n = self.reverse, self.reverse.of[0].size
        out: FloatArray = np.zeros(())
        spectrum: NDArray[np.complex128] | None = None
        for weight, i, j in terms:
            if j == 0 and self.y.whole:
                out = out + weight * x.of[i].sum()
            elif i == 0 and x.whole:
                out = out + weight * self.y.running(j, n)[: self.count]
            else:
                product = x.spectrum(i, weight) * self.y.spectrum(j)
                if spectrum is None:
                    spectrum = product
                else:
                    spectrum += product
        if spectrum is not None:
            out = out + fft.irfft(spectrum, self.size, overwrite_x=True)[n - 1 : n - 1 + self.count]
        return out


def _stretches(
    x: FloatArray, x_ok: BoolArray, y: FloatArray, y_ok: BoolArray
) -> Iterator[_Stretch]:
    from scipy import fft

    size = fft.next_fast_len(max(MIN_FFT, 4 * x.size), real=True)
    lags = size - x.size + 1
    reverse, level = _Powers(x[::-1], x_ok[::-1], _mean(x, x_ok), size), _mean(y, y_ok)
    for first in range(1 - x.size, y.size, lags):
        part = slice(max(first, 0), min(first + size, y.size))
        beyond = (part.start - first, first + size - part.stop)
        own, own_ok = y[part], y_ok[part]
        if any(beyond):
            own, own_ok = np.pad(own, beyond), np.pad(own_ok, beyond)
        long = _Powers(own, own_ok, level, size)
        yield _Stretch(first, min(lags, y.size - first), size, reverse, long)


def _mean(v: FloatArray, ok: BoolArray) -> float:
    return float(v[ok].mean()) if ok.any() else 0.0


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
