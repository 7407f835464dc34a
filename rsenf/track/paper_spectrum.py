"""Sliding Hann spectra of many slow-time series near one carrier, a hop at a time.

The Fourier sum of a window is the sum of its hops', so each hop is transformed once rather than
once for every window it is in. A Hann window is a constant plus one period of a cosine, so its
spectrum follows from the rectangular window's at three frequencies:
``½·S(f) + ¼·S(f − 1/W)·e^(−j2πc/W) + ¼·S(f + 1/W)·e^(j2πc/W)`` about the window's centre ``c``.
"""

from __future__ import annotations

import itertools
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.slow_time import SlowTime
from rsenf.flicker.tone import Tone

Complex = NDArray[np.complex128]
Float = NDArray[np.float64]

# Points of the frequency grid per 1/W, as of a transform zero-padded to four times its length.
OVERSAMPLING = 4


class SlidingSpectrum:
    """Hann spectra at exact frame times; missing frames count nothing.

    The static part of the picture, the mean of each series over all frames so far, is subtracted.
    It is at 0 Hz in slow time, where the alias of ``f_0`` is at 25 frames/s and 50 Hz: its texture
    would be the strongest line there. (The mean over the window alone would remove the flicker too,
    whose alias hardly turns within 20 s.)

    Parameters
    ----------
    carrier_hz : float
        Middle of the band.
    columns : ndarray of int, shape (series,)
        Columns of the buffer's values.
    window_s, hop_s : float
        The first a whole multiple of the second.
    search_hz : float
        Half-width of the band.
    """

    def __init__(
        self,
        carrier_hz: float,
        columns: NDArray[np.int64],
        window_s: float,
        hop_s: float,
        search_hz: float,
    ) -> None:
        self.carrier_hz, self.columns = carrier_hz, columns
        self._window_s, self._hop_s = window_s, hop_s
        step_hz = 1.0 / (OVERSAMPLING * window_s)
        half = int(np.ceil(search_hz / step_hz))
        self.offsets_hz = np.arange(-half, half + 1) * step_hz
        beyond = np.arange(-half - OVERSAMPLING, half + OVERSAMPLING + 1) * step_hz
        self._grid_hz = carrier_hz + beyond
        self.unit_var_hz2 = _unit_variance(window_s)
        # Spectra of the last hops (of the series, then of a constant), and their frame counts.
        self._hops: deque[tuple[Complex, int]] = deque(maxlen=round(window_s / hop_s))
        self._taken = 0
        self._frames = 0
        self._total = np.zeros(columns.size, np.complex128)

    def of_window(self, buffer: SlowTime, number: int) -> Complex:
        """Spectra of the window that begins with a hop, in levels, shape (offsets, series).

        Windows must be requested in order, while the buffer still has their frames.

        Parameters
        ----------
        buffer : SlowTime
        number : int
            Number of the hop.
        """
        while self._taken < number + (self._hops.maxlen or 0):
            self._take(buffer)
        whole, frames = self._hops[0]
        for spectrum, count in itertools.islice(self._hops, 1, None):
            whole, frames = whole + spectrum, frames + count
        if not frames:
            return np.zeros((self.offsets_hz.size, self.columns.size), np.complex128)
        turn = np.exp(-2j * np.pi * (number * self._hop_s / self._window_s + 0.5))
        mid, side = slice(OVERSAMPLING, -OVERSAMPLING), 2 * OVERSAMPLING
        hann = whole[mid] + 0.5 * (turn * whole[:-side] + turn.conjugate() * whole[side:])
        still = self._total / self._frames
        return np.asarray((hann[:, :-1] - hann[:, -1:] * still) / frames, np.complex128)

    def _take(self, buffer: SlowTime) -> None:
        """Transform the next hop."""
        part = buffer.between(self._taken * self._hop_s, (self._taken + 1) * self._hop_s)
        values = buffer.values(part)[:, self.columns]
        turns = np.exp(-2j * np.pi * self._grid_hz[:, None] * buffer.times(part))
        constant = np.ones((values.shape[0], 1))
        self._hops.append((turns @ np.concatenate([values, constant], axis=1), values.shape[0]))
        self._total += values.sum(axis=0)
        self._frames += values.shape[0]
        self._taken += 1


class Peaks(NamedTuple):
    """The strongest tone of each series; arrays of shape (series,).

    ``snr`` is its power over the noise power in a cell, ``one_sided`` its power over that at the
    mirrored alias.
    """

    offset_hz: Float
    offset_var_hz2: Float
    amplitude: Float
    snr: Float
    one_sided: Float
    at_edge: NDArray[np.bool_]

    def tone(self, i: int) -> Tone:
        """Return the tone of one series."""
        return Tone(
            float(self.offset_hz[i]), float(self.offset_var_hz2[i]), float(self.amplitude[i]),
            float(self.snr[i]), bool(self.at_edge[i]),
        )  # fmt: skip


def peaks(spectrum: Complex, of: SlidingSpectrum, alias_hz: float) -> Peaks:
    """Find the maximum of each spectrum, refined by quadratic interpolation of its logarithm.

    Noise power is exponentially distributed: its mean is its median over the band, over ln 2.

    Parameters
    ----------
    spectrum : ndarray of complex, shape (offsets, series)
    of : SlidingSpectrum
        Where the spectrum is from.
    alias_hz : float
        Alias of the carrier.
    """
    power = spectrum.real**2 + spectrum.imag**2
    top = np.argmax(power, axis=0)
    at_edge = (top == 0) | (top == len(power) - 1)
    series = np.arange(power.shape[1])
    middle = np.clip(top, 1, len(power) - 2)
    a, b, c = (
        np.log(np.maximum(power[middle + i, series], np.finfo(float).tiny)) for i in (-1, 0, 1)
    )
    bend = np.where(at_edge, 0.0, a - 2.0 * b + c)
    shift = np.divide(0.5 * (a - c), bend, out=np.zeros_like(bend), where=bend < 0.0)
    height = np.where(bend < 0.0, np.exp(b - 0.25 * (a - c) * shift), power[top, series])
    step_hz = of.offsets_hz[1] - of.offsets_hz[0]
    offset_hz = of.offsets_hz[top] + shift * step_hz
    snr = _ratio(height, np.median(power, axis=0) / np.log(2.0))
    mirror = np.rint((-2.0 * alias_hz - offset_hz - of.offsets_hz[0]) / step_hz).astype(np.int64)
    seen = (mirror >= 0) & (mirror < len(power))
    other = np.where(seen, power[np.where(seen, mirror, 0), series], 0.0)
    variance = np.divide(of.unit_var_hz2, snr, out=np.full_like(snr, np.inf), where=snr > 0.0)
    return Peaks(offset_hz, variance, np.sqrt(height), snr, _ratio(height, other), at_edge)


def _ratio(power: Float, over: Float) -> Float:
    """Ratio of powers: infinite over 0, but 0 if both are 0."""
    nothing = np.where(power > 0.0, np.inf, 0.0)
    return np.divide(power, over, out=nothing, where=over > 0.0)


def _unit_variance(window_s: float) -> float:
    """Variance of a frequency (Hz²) for unit signal-to-noise power in a cell, of a full window.

    As in :class:`rsenf.flicker.tone.ToneFinder`, in the limit of many frames.
    """
    t = (np.arange(1000) + 0.5) / 1000 - 0.5
    w = np.cos(np.pi * t) ** 2
    w /= w.sum()
    spread = (w**2 @ t**2) / (w @ t**2) ** 2 / (w @ w)
    return float(spread) / (2.0 * np.pi * window_s) ** 2 / 2.0
