"""Frequency and amplitude of one tone in a complex series with gaps, with their errors.

Frame times need not be uniform: the sums run over exact times. A constant beside the tone (the
picture's texture, which projects onto every line) is fitted jointly, as in the floating-mean
periodogram (Zechmeister, M. and Kürster, M. (2009), A&A 496, 577): an alias near 0 Hz then costs
precision instead of giving a wrong frequency.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]
Float = NDArray[np.float64]

# Bins of the grid per resolution cell of a Hann window of the same length: fine enough for the
# error of quadratic interpolation to be below 1e-3 of a cell.
OVERSAMPLING = 4
GROUP = 12  # near the square root of the number of offsets
# Cells on either side of the tone in which noise is measured.
NOISE_CELLS = 10
# Least power of a Hann peak's neighbours on the grid, relative to it; else it is no such peak.
MIN_NEIGHBOUR = 0.25
AT_EDGE = "strongest at the edge of the search band: played at another speed, or wrong frame times?"


def turning(phase_rad: NDArray[np.floating]) -> NDArray[np.complex128]:
    """Return ``exp(j·φ)``; cosine and sine are many times faster than the complex exponential."""
    out = np.empty(phase_rad.shape, np.complex128)
    out.real, out.imag = np.cos(phase_rad), np.sin(phase_rad)
    return out


def decibels(ratio: float) -> float:
    """Return a ratio of powers in dB; NaN unless it is positive and finite.

    Examples
    --------
    >>> decibels(100.0), decibels(0.0)
    (20.0, nan)
    """
    return float(10.0 * np.log10(ratio)) if 0 < ratio < np.inf else float("nan")


def hann(t_s: Float, length_s: float) -> Float:
    """Hann weights at times from the centre, summing to 1 (Harris 1978)."""
    weights = np.cos(np.pi * np.clip(t_s / length_s, -0.5, 0.5)) ** 2
    return np.asarray(weights / weights.sum(), np.float64)


@dataclass(frozen=True)
class Tone:
    """Strongest tone within the search band.

    ``snr`` is its power over the noise power in one resolution cell; infinite if the
    neighbourhood is exactly empty. ``offset_var_hz2`` is the variance of ``offset_hz`` by the
    linearised least-squares fit under the window.
    """

    offset_hz: float
    offset_var_hz2: float
    amplitude: float
    snr: float
    at_edge: bool


class ToneFinder:
    """Windowed floating-mean periodogram on a grid of offsets from a carrier.

    Parameters
    ----------
    window_s : float
        Length of the Hann window.
    search_hz : float
        Half-width of the band searched around the carrier.

    Examples
    --------
    >>> t_s = np.arange(-250, 251) / 25.0
    >>> finder = ToneFinder(20.0, 1.0)
    >>> series = 0.3 * np.exp(2j * np.pi * 0.32 * t_s)
    >>> _, power = finder.periodograms(series[:, None], np.exp(-2j * np.pi * 10.0 * t_s), t_s)
    >>> tone = finder.strongest(power[:, 0], t_s)
    >>> round(tone.offset_hz, 3), round(tone.amplitude, 3)
    (0.32, 0.3)
    """

    def __init__(self, window_s: float, search_hz: float) -> None:
        step_hz = 1.0 / (OVERSAMPLING * window_s)
        half = max(int(np.ceil(search_hz / step_hz)), NOISE_CELLS * OVERSAMPLING)
        self.window_s, self.search_hz = window_s, search_hz
        self.offsets_hz = np.arange(-half, half + 1) * step_hz

    def window(self, t_s: Float) -> Float:
        """Hann weights at times relative to the window's centre, summing to 1."""
        return hann(t_s, self.window_s)

    def periodograms(
        self, baseband: Complex, carrier: Complex, t_s: Float
    ) -> tuple[Complex, Float]:
        """Amplitude and power of the tone at every offset, for several series at once.

        Parameters
        ----------
        baseband : ndarray of complex, shape (samples, series)
            Series times ``carrier``.
        carrier : ndarray of complex, shape (samples,)
            ``exp(−j·2π·f·t)``: a constant's image in baseband.
        t_s : ndarray, shape (samples,)
            Times relative to the window's centre.

        Returns
        -------
        amplitude : ndarray of complex, shape (offsets, series)
        power : ndarray, shape (offsets, series)
            ``|amplitude|²`` times the share of the tone that is orthogonal to the constant.
        """
        weights = self.window(t_s)
        turns = self._rotations(t_s, weights)
        # Gram matrix of {constant, tone}: 1 on the diagonal, overlap beside it.
        overlap = turns @ carrier
        mean = (weights * carrier.conj()) @ baseband
        orthogonal = np.maximum(1.0 - np.abs(overlap) ** 2, 1e-12)
        amplitude = (turns @ baseband - overlap[:, None] * mean) / orthogonal[:, None]
        return amplitude, np.abs(amplitude) ** 2 * orthogonal[:, None]

    def _rotations(self, t_s: Float, weights: Float) -> Complex:
        """``exp(−j·2π·offset·t)`` times the weights, shape (offsets, samples).

        Offsets are equidistant: each rotation is the first of its group times one within the group,
        the same in all groups.
        """
        step_hz = self.offsets_hz[1] - self.offsets_hz[0]
        within = turning(-2.0 * np.pi * np.outer(np.arange(GROUP) * step_hz, t_s))
        groups = turning(-2.0 * np.pi * np.outer(self.offsets_hz[::GROUP], t_s)) * weights
        every = groups[:, None] * within
        return every.reshape(-1, t_s.size)[: self.offsets_hz.size]

    def strongest(self, power: Float, t_s: Float) -> Tone:
        """Peak of one periodogram: quadratic interpolation of its logarithm, and its errors.

        Parameters
        ----------
        power : ndarray, shape (offsets,)
        t_s : ndarray, shape (samples,)
            Times relative to the window's centre.
        """
        peak = int(np.argmax(power))
        at_edge = peak in (0, power.size - 1)
        delta, height = (0.0, power[peak]) if at_edge else _parabola(power[peak - 1 : peak + 2])
        step_hz = self.offsets_hz[1] - self.offsets_hz[0]
        noise = self._noise(power, peak)
        snr = float(height / noise) if noise > 0 else (np.inf if height > 0 else 0.0)
        return Tone(
            offset_hz=float(self.offsets_hz[peak] + delta * step_hz),
            offset_var_hz2=self._frequency_variance(t_s) / (2.0 * snr) if snr > 0 else np.inf,
            amplitude=float(np.sqrt(height)),
            snr=snr,
            at_edge=at_edge,
        )

    @staticmethod
    def _noise(power: Float, peak: int) -> float:
        """Mean noise power of a cell, from the cells on either side of the Hann main lobe.

        Noise power is exponentially distributed: its mean is its median over ln 2, which is robust
        against a second line nearby. Only near cells count, since noise is seldom white.
        """
        away = np.abs(np.arange(power.size) - peak)
        near = (away > 2 * OVERSAMPLING) & (away <= NOISE_CELLS * OVERSAMPLING)
        return float(np.median(power[near]) / np.log(2.0))

    def _frequency_variance(self, t_s: Float) -> float:
        """Variance of the frequency (Hz²) for unit noise-to-signal power in a cell.

        Least squares with weights ``w``: ``var ω = σ² Σw²t² / (Σw t²)² / A²``, and the noise power
        of a cell is ``σ² Σw²``; ``t`` from the weighted mean time.
        """
        w = self.window(t_s)
        t = t_s - w @ t_s
        return float((w**2 @ t**2) / (w @ t**2) ** 2 / (w @ w) / (2.0 * np.pi) ** 2)


def _parabola(three: Float) -> tuple[float, float]:
    """Vertex of a parabola through three equidistant points of the logarithm."""
    if min(three[0], three[2]) < MIN_NEIGHBOUR * three[1]:
        return 0.0, float(three[1])
    a, b, c = np.log(np.maximum(three, np.finfo(float).tiny))
    bend = a - 2.0 * b + c
    if bend >= 0.0:
        return 0.0, float(three[1])
    delta = float(np.clip(0.5 * (a - c) / bend, -0.5, 0.5))
    return delta, float(np.exp(b - 0.25 * (a - c) * delta))
