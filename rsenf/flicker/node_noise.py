"""Noise of sums at the nodes, from their periodogram near, but not at, 0 Hz.

The median of exponentially distributed powers is ln 2 of their mean, and robust against a line
nearby.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import NODE_S
from rsenf.medians import median_of_few

Float = NDArray[np.float64]

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
