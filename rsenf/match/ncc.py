"""Masked residuals and normalised cross-correlation at every lag, by FFT.

At lag ``l`` the value ``x[i]`` is paired with ``y[i + l]``; a pair counts if both are valid. All
results follow from sums over the pairs of a lag (number, Σx, Σy, Σx², Σy², Σxy), which are
cross-correlations of the zero-filled series, their squares and their masks (Padfield, "Masked
object registration in the Fourier domain", IEEE Trans. Image Processing 21(5), 2012). Terms are
added in the frequency domain, and a mask without holes is not transformed. The long series is taken
in overlapping stretches (overlap-save), so that a year needs no more memory than a day, apart from
its results.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import FloatArray

BoolArray = NDArray[np.bool_]

MIN_FFT = 1 << 15  # measured: longer ones overflow the CPU cache
ROUNDING = 1e-11  # of the series' own variance: a smaller variance is rounding error


@dataclass(frozen=True, eq=False)
class Residuals:
    """Differences of two series at consecutive lags; NaN where there are too few pairs.

    ``first_lag`` belongs to entry 0. The arrays have one entry per lag: ``pairs`` is the number of
    valid pairs, ``offset`` the mean of ``x − y`` (unit of the series), ``residual_var`` the
    variance of ``x − y`` about that offset.
    """

    first_lag: int
    pairs: NDArray[np.int64]
    offset: FloatArray
    residual_var: FloatArray

    @property
    def lags(self) -> NDArray[np.int64]:
        """Lag of each entry, in samples."""
        return np.arange(self.first_lag, self.first_lag + self.pairs.size)


@dataclass(frozen=True, eq=False)
class LagTable(Residuals):
    """Residuals with Pearson's coefficient over the pairs, ``correlation``."""

    correlation: FloatArray


def lag_residuals(
    x: FloatArray,
    x_ok: BoolArray,
    y: FloatArray,
    y_ok: BoolArray,
    *,
    min_pairs: int = 3,
    lags: range | None = None,
) -> Iterator[Residuals]:
    """Yield the residuals of :func:`lag_tables`, without the correlation.

    Of all lags, or of those in a range.
    """
    for stretch in _stretches(x, x_ok, y, y_ok, lags):
        yield _residuals(stretch, min_pairs)


def lag_tables(
    x: FloatArray, x_ok: BoolArray, y: FloatArray, y_ok: BoolArray, *, min_pairs: int = 3
) -> Iterator[LagTable]:
    """Compare ``x`` with ``y`` at every lag of overlap; yield stretches of lags (Padfield 2012).

    Parameters
    ----------
    x, y : ndarray of float, shapes (n,) and (N,)
        The short and the long series, with the same time step.
    x_ok, y_ok : ndarray of bool, shapes (n,) and (N,)
        Where they are valid; other values are ignored.
    min_pairs : int
        Lags with fewer valid pairs are NaN.

    Yields
    ------
    LagTable
        Together for lags ``−(n − 1)`` to ``N − 1``.

    Examples
    --------
    >>> y = np.array([5.0, 1.0, 4.0, 2.0, 8.0, 3.0, 7.0])
    >>> x = y[2:6] + 10.0
    >>> (table,) = lag_tables(x, np.ones(4, bool), y, np.ones(7, bool), min_pairs=4)
    >>> int(table.lags[np.nanargmax(table.correlation)])
    2
    """
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
    """The powers 0, 1 and 2 of a series less its level, zero where it isn't valid."""

    def __init__(self, v: FloatArray, ok: BoolArray, level: float, size: int) -> None:
        self.level, self.whole, self._size = level, bool(ok.all()), size
        centred = v - level if self.whole else np.where(ok, v - level, 0.0)
        self.of = (ok, centred, centred * centred)
        self._spectra: dict[tuple[int, float], NDArray[np.complex128]] = {}

    def spectrum(self, power: int, weight: float = 1.0) -> NDArray[np.complex128]:
        """Spectrum of a power times a weight, zero-padded to the FFT size."""
        from scipy import fft

        if (power, weight) not in self._spectra:
            self._spectra[power, weight] = fft.rfft(self.of[power], self._size)
            if weight != 1.0:
                self._spectra[power, weight] *= weight
        return self._spectra[power, weight]

    def running(self, power: int, length: int) -> FloatArray:
        """Running sums of a power over ``length`` consecutive values."""
        sums = np.concatenate([[0.0], np.cumsum(self.of[power])])
        return np.asarray(sums[length:] - sums[:-length], np.float64)


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Consecutive lags from ``first`` on: the short series and a part of the long one.

    ``reverse`` is the short series reversed, so that a convolution gives its cross-correlation.
    """

    first: int
    count: int
    size: int
    reverse: _Powers
    y: _Powers

    def sums(self, *terms: tuple[float, int, int]) -> FloatArray:
        """Return Σ weight · x^i · y^j over the pairs of each lag, for terms (weight, i, j).

        Shape () if it is the same at all lags.
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
    x: FloatArray, x_ok: BoolArray, y: FloatArray, y_ok: BoolArray, lags: range | None = None
) -> Iterator[_Stretch]:
    from scipy import fft

    start, stop = 1 - x.size, y.size
    if lags is not None:
        start, stop = max(lags.start, start), min(lags.stop, stop)
    if start >= stop:
        return
    # Stretches of equal length, so that none has hardly a lag.
    most = max(MIN_FFT, 4 * x.size) - x.size + 1
    step = -(-(stop - start) // -(-(stop - start) // most))
    size = fft.next_fast_len(step + x.size - 1, real=True)
    reverse, level = _Powers(x[::-1], x_ok[::-1], _mean(x, x_ok), size), _mean(y, y_ok)
    for first in range(start, stop, step):
        count = min(step, stop - first)
        part = slice(max(first, 0), min(first + count + x.size - 1, y.size))
        beyond = (part.start - first, first + count + x.size - 1 - part.stop)
        window, window_ok = y[part], y_ok[part]
        if any(beyond):
            window, window_ok = np.pad(window, beyond), np.pad(window_ok, beyond)
        long = _Powers(window, window_ok, level, size)
        yield _Stretch(first, count, size, reverse, long)


def _mean(v: FloatArray, ok: BoolArray) -> float:
    return float(v[ok].mean()) if ok.any() else 0.0


class LagResult(NamedTuple):
    """The result at one lag, computed directly."""

    pairs: int
    correlation: float
    offset: float
    residual_var: float


def compare_at(
    x: FloatArray, x_ok: BoolArray, y: FloatArray, y_ok: BoolArray, lag: int
) -> LagResult:
    """Compare at one lag by plain sums: exact where :func:`lag_tables` has rounding errors.

    NaN if the lag has no valid pair.

    Parameters
    ----------
    x, x_ok, y, y_ok
        As for :func:`lag_tables`.
    lag : int
    """
    a = max(0, -lag)
    b = max(a, min(x.size, y.size - lag))
    both = x_ok[a:b] & y_ok[a + lag : b + lag]
    xs, ys = x[a:b][both], y[a + lag : b + lag][both]
    if xs.size == 0:
        return LagResult(0, np.nan, np.nan, np.nan)
    difference = xs - ys
    dx, dy = xs - xs.mean(), ys - ys.mean()
    power_x, power_y = float(dx @ dx), float(dy @ dy)
    # A constant series leaves the rounding error of its mean, about 1e-16 of its level.
    varies = power_x > 1e-24 * float(xs @ xs) and power_y > 1e-24 * float(ys @ ys)
    correlation = float(dx @ dy) / (power_x * power_y) ** 0.5 if varies else np.nan
    return LagResult(xs.size, correlation, float(difference.mean()), float(difference.var()))
