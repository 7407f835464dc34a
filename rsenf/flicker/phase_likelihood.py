"""Likelihood of a phase: amplitudes, and what the frames at each node say of the phase.

The nodes of the phase are a quarter of a second apart. The sufficient statistics are sums over the
frames around each node: of waves times columns, and of waves times waves. Given a phase, amplitudes
follow by regularised least squares, and gradient and Fisher information of the phase from what they
leave. Noise is that of sums at the nodes, from their periodogram near, but not at, 0 Hz: the median
of exponentially distributed powers is ln 2 of their mean, and robust against a line nearby.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import NODE_S
from rsenf.flicker.tone import turning
from rsenf.medians import median_of_few

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class WindowFrames:
    """Frames of one window, in order; times may go back where a frame was repeated.

    Attributes
    ----------
    t_s : ndarray, shape (frames,)
        Times since the window's first node.
    carrier_rad : ndarray, shape (frames,)
        Phase of the nominal illumination frequency.
    columns : ndarray, shape (frames, columns)
        Reduced profiles.
    """

    t_s: Float
    carrier_rad: Float
    columns: Float


def at_frames(t_s: Float, values: Float) -> Float:
    """Interpolate values at nodes linearly.

    Parameters
    ----------
    t_s : ndarray
        Times since the first node, of any shape.
    values : ndarray, shape (nodes,)

    Examples
    --------
    >>> at_frames(np.array([0.125, 0.25]), np.array([0.0, 1.0, 4.0])).tolist()
    [0.5, 1.0]
    """
    left, beyond = _between(t_s, values.size)
    return _linear(values, left, beyond)


@dataclass(frozen=True, eq=False)
class SufficientStatistics:
    """Sums over the frames around each node; the first wave is the constant 1.

    Attributes
    ----------
    columns : ndarray, shape (nodes, waves, columns)
        Sums of waves times columns.
    waves : ndarray, shape (nodes, waves, waves)
        Sums of waves times waves.
    """

    columns: Float
    waves: Float

    def weighted(self, trust: Float) -> SufficientStatistics:
        """Return the sums with the nodes' robust weights, shape (nodes,)."""
        by_node = trust[:, None, None]
        return SufficientStatistics(by_node * self.columns, by_node * self.waves)

    def residuals(self, found: Float) -> Float:
        """Sums of waves times the columns' residuals, shape (nodes, waves, columns).

        ``found`` holds the waves' coefficients in the columns, shape (waves, columns).
        """
        modelled = self.waves.reshape(-1, len(found)) @ found
        return self.columns - modelled.reshape(self.columns.shape)


class Gathered:
    """Frames grouped by their nearest nodes.

    Parameters
    ----------
    frames : WindowFrames
    nodes : int

    Attributes
    ----------
    there : ndarray of bool, shape (nodes, places)
        Whether a place holds a frame.
    columns : ndarray, shape (nodes, places, columns)
    carrier_rad : ndarray, shape (nodes, places)
    carrier_hz, rate_hz : float
        Frequency of the carrier; frame rate.
    """

    def __init__(self, frames: WindowFrames, nodes: int) -> None:
        nearest = np.clip(np.rint(frames.t_s / NODE_S).astype(np.intp), 0, nodes - 1)
        count = np.bincount(nearest, minlength=nodes)
        place = np.empty_like(nearest)  # among the node's frames; times may go back
        by_node = np.argsort(nearest, kind="stable")
        place[by_node] = np.arange(nearest.size) - np.repeat(np.cumsum(count) - count, count)
        self.there = np.arange(max(int(count.max()), 1)) < count[:, None]
        self.columns = np.zeros((*self.there.shape, frames.columns.shape[1]))
        self.columns[nearest, place] = frames.columns
        self.carrier_rad, t_s = np.zeros(self.there.shape), np.zeros(self.there.shape)
        self.carrier_rad[nearest, place], t_s[nearest, place] = frames.carrier_rad, frames.t_s
        lasted_s = max(float(frames.t_s[-1] - frames.t_s[0]), 1e-9)
        turned_rad = float(frames.carrier_rad[-1] - frames.carrier_rad[0])
        self.carrier_hz = turned_rad / (2.0 * np.pi * lasted_s)
        self.rate_hz = 1.0 / max(float(np.median(np.diff(frames.t_s))), 1e-9)
        self._left, self._beyond = _between(t_s, nodes)
        self._place = nearest, place

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self._place[0].size)

    def phase_rad(self, psi_rad: Float) -> Float:
        """Phase at every place, from the nodes' phase relative to the carrier."""
        return self.carrier_rad + _linear(psi_rad, self._left, self._beyond)

    def in_order(self, values: NDArray[np.complex128]) -> Complex:
        """Values of the frames in the order of time, from those at all places."""
        return np.asarray(values[self._place])

    def waves(self, phase_rad: Float, orders: tuple[float, ...]) -> Float:
        """A constant, and cosine and sine of some orders of a phase, shape (nodes, waves, places).

        All are 0 where there is no frame.

        Parameters
        ----------
        phase_rad : ndarray, shape (nodes, places)
        orders : tuple of float
        """
        out = np.empty((self.there.shape[0], 1 + 2 * len(orders), self.there.shape[1]))
        out[:, 0] = self.there
        half = turning(0.5 * phase_rad) if any(order % 1 for order in orders) else None
        first = turning(phase_rad) if half is None else half * half
        powers = [self.there * 1.0, self.there * first]
        for i, order in enumerate(orders):
            while len(powers) <= order:
                powers.append(powers[-1] * first)
            wave = powers[int(order)]
            if half is not None and order % 1:
                wave = wave * half
            out[:, 1 + 2 * i], out[:, 2 + 2 * i] = wave.real, wave.imag
        return out

    def sums(self, waves: Float) -> SufficientStatistics:
        """Sum the frames around each node."""
        return SufficientStatistics(waves @ self.columns, waves @ waves.transpose(0, 2, 1))


def _between(t_s: Float, nodes: int) -> tuple[NDArray[np.intp], Float]:
    """Node to the left of each time, and the distance beyond it in nodes."""
    left = np.clip((t_s / NODE_S).astype(np.intp), 0, nodes - 2)
    return left, t_s / NODE_S - left


def _linear(values: Float, left: NDArray[np.intp], beyond: Float) -> Float:
    return np.asarray(values[left] * (1.0 - beyond) + values[left + 1] * beyond)


HARMONICS = 3
# Prior relative amplitude of harmonics: where two share an alias (one mirrored), the first one
# takes precedence.
HARMONIC_SIZE = {1.0: 3.0, 2.0: 0.3}
FURTHER_SIZE = 0.1
RIDGE = 1e-4
# Degrees of freedom of Student's t: key frames and cuts are rare outliers.
TAILS = 4.0
# A column's amplitude is shrunk (positive part) by this many of its variances.
SIGNIFICANT = 4.0

# Bands beside a tone in which noise is measured. In quadrature to the phase it may start near the
# tone; along the phase, the fit has absorbed whatever is slow.
COLUMNS_HZ, ALONG_HZ, ACROSS_HZ = (0.3, 1.6), (0.2, 0.8), (0.05, 0.5)
# In this band the path follows what the columns have in common.
SLOW_HZ = (0.02, 0.2)
FEWEST = 4  # fewest frequencies for a median; a short window's band is extended upwards
# Smoothing window of the flicker's amplitude (nodes), and weight of its shrinkage to the window's.
GAIN_WINDOW, STEADY = np.hanning(26)[1:-1], 0.1


def noise_of(series: Float, band_hz: tuple[float, float]) -> Float:
    """Noise power of several real series, shape (nodes, …), one number each, shape (…).

    Parameters
    ----------
    series : ndarray, shape (nodes, …)
    band_hz : tuple of float
        Band in which the noise is measured.
    """
    real, imag = _transforms(series, band_hz)
    # Both sides of 0 Hz have the same powers, so one side gives the same median.
    return np.asarray(median_of_few(real**2 + imag**2) / np.log(2.0))


def power_of(series: Float, band_hz: tuple[float, float]) -> Float:
    """Mean power of several real series, shape (nodes, …), in a band, shape (…).

    Parameters
    ----------
    series : ndarray, shape (nodes, …)
    band_hz : tuple of float
    """
    real, imag = _transforms(series, band_hz, fewest=1)
    return np.asarray(np.mean(real**2 + imag**2, axis=-1))


def noise_of_turning(real: Float, imag: Float, band_hz: tuple[float, float]) -> Float:
    """Noise power of several complex series, given by their parts, shapes (nodes, …).

    With ``A`` and ``B`` the transforms of the parts, that of the series is ``A + j·B`` above 0 Hz,
    and the conjugate of ``A − j·B`` below.

    Parameters
    ----------
    real, imag : ndarray, shape (nodes, …)
    band_hz : tuple of float
    """
    a_re, a_im = _transforms(real, band_hz)
    b_re, b_im = _transforms(imag, band_hz)
    above = (a_re - b_im) ** 2 + (a_im + b_re) ** 2
    below = (a_re + b_im) ** 2 + (b_re - a_im) ** 2
    return np.asarray(median_of_few(np.concatenate([above, below], axis=-1)) / np.log(2.0))


def _transforms(
    series: Float, band_hz: tuple[float, float], fewest: int = FEWEST
) -> tuple[Float, Float]:
    """Real and imaginary part of the transforms above 0 Hz, shape (…, frequencies)."""
    nodes, *several = series.shape
    waves = _waves(nodes, band_hz, fewest)
    both = (series.reshape(nodes, -1).T @ waves).reshape(*several, -1)
    half = waves.shape[1] // 2
    return both[..., :half], both[..., half:]


@functools.cache
def _waves(nodes: int, band_hz: tuple[float, float], fewest: int) -> Float:
    """Vectors of the discrete Fourier transform in a band: far fewer than all.

    Cosines first, then as many sines: shape (nodes, 2·frequencies).
    """
    freq_hz = np.fft.fftfreq(nodes, NODE_S)[: (nodes + 1) // 2]
    first = int(np.searchsorted(freq_hz, band_hz[0]))
    end = int(np.searchsorted(freq_hz, band_hz[1], "right"))
    among = np.arange(first, min(max(end, first + fewest), freq_hz.size))
    angle = 2.0 * np.pi * np.outer(np.arange(nodes), among) / nodes
    return np.hstack([np.cos(angle), -np.sin(angle)])


def gain_around(across: Float, expected: Float) -> Float:
    """Amplitude of the flicker around each node relative to the window's, from 0 to 1.5.

    Parameters
    ----------
    across : ndarray, shape (nodes, …)
        Residual along the flicker's amplitude, weighted as the flicker is.
    expected : ndarray, shape (nodes, …)
        The flicker itself, with the same weights.
    """
    around = _around(across.shape[0])
    beyond, share = around @ across, around @ expected
    steady = STEADY * share.max(axis=0)
    gain = 1.0 + beyond / np.maximum(share + steady, 1e-30)
    return np.asarray(np.minimum(np.maximum(gain, 0.0), 1.5))


@functools.cache
def _around(nodes: int) -> Float:
    """Matrix that smooths over nodes by :data:`GAIN_WINDOW`."""
    half = (GAIN_WINDOW.size - 1) // 2
    return np.array([np.convolve(one, GAIN_WINDOW)[half:][:nodes] for one in np.eye(nodes)]).T


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """Least-squares amplitudes for a given phase.

    Attributes
    ----------
    harmonic : ndarray of complex, shape (HARMONICS, columns)
        ``C_k``, with insignificant ones shrunk to 0.
    weights : ndarray, shape (HARMONICS, columns)
        Inverse noise variance of the columns near each harmonic.
    found : ndarray, shape (waves, columns)
        Coefficients of the waves in the columns.
    stats : SufficientStatistics
        The sums that they follow from.
    residuals : ndarray, shape (nodes, HARMONICS, columns)
        Sums of the residual times ``exp(j·k·φ)``.
    """

    harmonic: Complex
    weights: Float
    found: Float
    stats: SufficientStatistics
    residuals: Complex


def amplitudes_of(
    stats: SufficientStatistics, trust: Float, orders: tuple[float, ...]
) -> Amplitudes:
    """Fit the amplitudes of some orders, nodes weighted by how far they are trusted."""
    gram = _weighted(trust, stats.waves)
    count, weight = float(stats.waves[:, 0, 0].sum()), float(gram[0, 0])
    ridge = np.repeat([RIDGE * count / HARMONIC_SIZE.get(k, FURTHER_SIZE) ** 2 for k in orders], 2)
    gram.flat[:: len(gram) + 1] += np.concatenate([[0.0], ridge])
    found = np.asarray(np.linalg.solve(gram, _weighted(trust, stats.columns)))
    harmonics = slice(1, 1 + 2 * HARMONICS)  # cosine and sine of each
    modelled = stats.waves[:, harmonics].reshape(-1, len(found)) @ found
    residual = stats.columns[:, harmonics] - modelled.reshape(stats.columns[:, harmonics].shape)
    real, imag = residual[:, 0::2], residual[:, 1::2]
    raw = found[1 : 2 * HARMONICS : 2] - 1j * found[2 : 2 * HARMONICS + 1 : 2]
    node_weight = trust[:, None, None]
    noise = noise_of_turning(node_weight * real, node_weight * imag, COLUMNS_HZ) / weight
    noise = np.maximum(noise, 1e-6 * noise.max(axis=1, keepdims=True) + 1e-12)
    doubt = SIGNIFICANT * 4.0 * noise / count
    shrink = np.maximum(0.0, 1.0 - doubt / np.maximum(np.abs(raw) ** 2, 1e-30))
    return Amplitudes(raw * shrink, np.asarray(1.0 / noise), found, stats, real + 1j * imag)


def _weighted(trust: Float, sums: Float) -> Float:
    """Sum over the nodes with their robust weights."""
    return (trust @ sums.reshape(trust.size, -1)).reshape(sums.shape[1:])


def likelihood(amplitude: Amplitudes, trust: Float) -> tuple[Float, Float, Float, Float]:
    """Gradient and Fisher information of each node's phase, from all harmonics (Kay 1993, ch. 3).

    Also the next robust weight of each node, and the first harmonic's gain.
    """
    order = np.arange(1, HARMONICS + 1)
    weighted = amplitude.weights * amplitude.harmonic
    score = order * np.einsum("nkc,kc->nk", amplitude.residuals, weighted)
    along, across = -score.imag, score.real
    # Sum over the columns of a wave's square along the phase: Σ w·(k·Im turn·C)².
    power = (weighted * amplitude.harmonic.conj()).sum(axis=1).real
    turned = (weighted * amplitude.harmonic).sum(axis=1)
    frames_at, squared = _squares(amplitude.stats)
    expected = 0.5 * order**2 * (power * frames_at - (squared * turned).real)
    hears = expected.sum(axis=0) > 0.0
    weight = trust[:, None]
    total = np.where(hears, (weight * expected).sum(axis=0), 1.0)
    # Noise may be correlated between columns: it is measured on their weighted sum.
    noise = np.maximum(noise_of(weight * along, ALONG_HZ), noise_of(weight * across, ACROSS_HZ))
    excess = np.maximum(noise / total, 1e-3)
    gain = gain_around(weight * across, weight * expected)
    gradient = np.where(hears, gain * weight * along / excess, 0.0).sum(axis=1)
    information = np.where(hears, gain**2 * weight * expected / excess, 0.0).sum(axis=1)
    if not hears[0]:
        return gradient, information, trust, np.ones(trust.size)
    away = along[:, 0] ** 2 + across[:, 0] ** 2
    away /= np.maximum(expected[:, 0] * excess[0], 1e-30)
    return gradient, information, (TAILS + 2.0) / (TAILS + away), gain[:, 0]


def _squares(stats: SufficientStatistics) -> tuple[Float, Complex]:
    """Number of frames around each node, (nodes, 1), and the sums of ``exp(2j·k·φ)``."""
    cosine, sine = (range(first, 2 * HARMONICS + 1, 2) for first in (1, 2))
    of = stats.waves
    squared = of[:, cosine, cosine] - of[:, sine, sine] + 2j * of[:, cosine, sine]
    return of[:, :1, 0], squared
