"""One window: the fit of a tone at each line, and the tone's phase course.

The fit gives the tone, the constant beside it, and the flicker's amplitude. Its frequency is the
slope of one phase through all of the window. At a lost frame the phase jumps, and the slope is
wrong though both sides are right; another light that beats with the tone makes the phase swing. So
the tone's own phase is subtracted, the rest averaged over short times, and its mean square compared
with that of noise and of a grid's wander (:mod:`rsenf.flicker.grid_prior`).
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import FREE, NODE_S, Wander, phase_prior, wander_of
from rsenf.flicker.lines import Line
from rsenf.flicker.slow_time import SlowTime
from rsenf.flicker.tone import Tone, ToneFinder, hann
from rsenf.medians import MEDIAN_SQUARE
from rsenf.timebase import nanoseconds


@dataclasses.dataclass(frozen=True)
class LineFit:
    """Fit of one window at one line.

    ``constant`` is the texture's projection onto the line, ``noise_level2`` the noise power of a
    single frame (levels²). ``one_sided`` is the tone's power over that at the mirrored alias: large
    for flicker, which runs down the rows in one direction; brightness drift only scales a standing
    pattern, whose spectrum is symmetric about 0 Hz.
    """

    line: Line
    tone: Tone
    constant: complex
    noise_level2: float
    one_sided: float


def fit_lines(
    finder: ToneFinder,
    buffer: SlowTime,
    columns: dict[Line, int],
    start_s: float,
    end_s: float,
    frame_rate_hz: float,
) -> list[LineFit]:
    """Fit the given lines, each in its column of the buffer.

    Lines of one harmonic differ in their ramps only: they share carrier and rotations.

    Parameters
    ----------
    finder : ToneFinder
    buffer : SlowTime
    columns : dict of Line to int
        Column of each line.
    start_s, end_s : float
        The window.
    frame_rate_hz : float
    """
    part = buffer.between(start_s, end_s)
    t_s = buffer.times(part) - (start_s + end_s) / 2.0
    weights = finder.window(t_s)
    out = []
    for carrier_hz in dict.fromkeys(line.carrier_hz for line in columns):
        group = [line for line in columns if line.carrier_hz == carrier_hz]
        carrier = np.exp(-2j * np.pi * carrier_hz * buffer.times(part))
        baseband = buffer.values(part)[:, [columns[x] for x in group]] * carrier[:, None]
        amplitude, power = finder.periodograms(baseband, carrier, t_s)
        means = (weights * carrier.conj()) @ baseband
        for i, line in enumerate(group):
            tone = finder.strongest(power[:, i], t_s)
            peak = int(np.argmax(power[:, i]))
            turn = np.exp(2j * np.pi * finder.offsets_hz[peak] * t_s)
            overlap = (weights * carrier.conj()) @ turn
            noise = tone.amplitude**2 / tone.snr / (weights @ weights) if tone.snr else 0.0
            constant = complex(means[i] - amplitude[peak, i] * overlap)
            mirror_hz = -2.0 * line.alias_hz(frame_rate_hz) - tone.offset_hz
            mirror = np.interp(mirror_hz, finder.offsets_hz, power[:, i], left=0.0, right=0.0)
            one_sided = tone.amplitude**2 / mirror if mirror > 0 else np.inf
            out.append(LineFit(line, tone, constant, float(noise), float(one_sided)))
    return out


def slow_time_amplitude(
    fit: LineFit, buffer: SlowTime, column: int, centre_s: float, hop_s: float
) -> dict[str, Any]:
    """Complex amplitude over the window's middle hop, less the texture.

    Parameters
    ----------
    fit : LineFit
    buffer : SlowTime
    column : int
        The line's column of the buffer.
    centre_s, hop_s : float

    Returns
    -------
    dict
        The amplitude fields of :class:`rsenf.messages.EnfEstimate`; empty without frames.
    """
    part = buffer.between(centre_s - hop_s / 2, centre_s + hop_s / 2)
    count = part.stop - part.start
    if count == 0:
        return {}
    carrier = np.exp(-2j * np.pi * fit.line.carrier_hz * buffer.times(part))
    amplitude = np.mean((buffer.values(part)[:, column] - fit.constant) * carrier)
    variance = np.array([fit.noise_level2 / (2.0 * count)])
    return {
        "carrier_hz": fit.line.carrier_hz,
        "points": 1,
        "amplitude_pts_ns": np.array([buffer.origin_ns + nanoseconds(centre_s)]),
        "amplitude_re": np.array([amplitude.real]),
        "amplitude_im": np.array([amplitude.imag]),
        "amplitude_var_re": variance,
        "amplitude_var_im": variance,
        "amplitude_cov": np.zeros(1),
    }


Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

STEP_S = 2.0 * NODE_S  # half the length of the Hann windows: from one average to the next
MIN_HALF = 5  # fewest steps on either side of the centre
# Correlation of the noise of Hann windows that overlap by half.
OVERLAP = 1.0 / 6.0
# Variance of second differences of such averages' noise, over its own.
SECOND_DIFFERENCE = 6.0 - 8.0 * OVERLAP
# Least amplitude of another series, relative to the tone's, for a comparison of frequencies.
MIN_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class TonePhase:
    """Phase of a tone relative to its constant frequency, through a window.

    Attributes
    ----------
    stray_rad : ndarray, shape (2·half + 1,)
        Phase of the averages.
    filled : ndarray of bool, shape (2·half + 1,)
        Whether an average has its frames.
    """

    stray_rad: Float
    filled: NDArray[np.bool_]

    @property
    def half(self) -> int:
        """Number of averages on either side of the centre."""
        return self.stray_rad.size // 2

    @functools.cached_property
    def _noise_rad2(self) -> float:
        """Noise variance of an average: a median, since a jump is in few of the differences."""
        bends = np.diff(self.stray_rad, 2) ** 2
        known = self.filled[2:] & self.filled[1:-1] & self.filled[:-2]
        if not known.any():
            return float("inf")
        return float(np.median(bends[known])) / (SECOND_DIFFERENCE * MEDIAN_SQUARE) + 1e-10

    @functools.cached_property
    def _squares_rad2(self) -> tuple[float, float]:
        """Weighted mean square about the nearest line, and that of a grid."""
        weights, line, usual_rad2 = _usual(self.half)
        weights = weights * self.filled
        root = np.sqrt(weights / weights.sum())
        near, _ = np.linalg.qr(line * root[:, None])
        seen = self.stray_rad * root
        return float(np.sum((seen - near @ (near.T @ seen)) ** 2)), usual_rad2

    @property
    def excess(self) -> float:
        """Mean square deviation over that of noise and a grid's wander: 1 on average."""
        if self.half < MIN_HALF:
            return 1.0
        seen, usual = self._squares_rad2
        return seen / (usual + self._noise_rad2)

    @property
    def wander(self) -> Wander:
        """Wander in the principal directions of a grid's phase.

        Deviations larger than a grid's count as noise.
        """
        if self.half < MIN_HALF:
            return Wander()
        seen, usual = self._squares_rad2
        noise = self._noise_rad2 + max(seen - usual - self._noise_rad2, 0.0)
        prior = phase_prior(4 * self.half + 1)
        basis = prior.basis[::2][self.filled]
        precision = basis.T @ basis / noise + np.eye(basis.shape[1])
        coefficient = np.linalg.solve(precision, basis.T @ self.stray_rad[self.filled] / noise)
        return wander_of(np.asarray(coefficient, np.float64), precision, prior.nodes)


@functools.lru_cache(maxsize=8)
def _usual(half: int) -> tuple[Float, Float, float]:
    """Hann weights, the lines through the window, and a grid's mean square about them."""
    t_s = np.asarray(STEP_S * np.arange(-half, half + 1), np.float64)
    weights = hann(t_s, 2.0 * STEP_S * (half + 1))
    line = np.column_stack([np.ones_like(t_s), t_s])
    root = np.sqrt(weights)[:, None]
    moves = phase_prior(4 * half + 1).basis[::2, FREE:] * root
    near, _ = np.linalg.qr(line * root)
    return weights, line, float(np.sum((moves - near @ (near.T @ moves)) ** 2))


def course_of(series: Complex, t_s: Float, tone_hz: float, window_s: float) -> TonePhase:
    """Follow the phase of a series relative to a tone's.

    Parameters
    ----------
    series : ndarray of complex, shape (frames,)
    t_s : ndarray, shape (frames,)
        Times from the window's centre.
    tone_hz, window_s : float
        Frequency of the tone; length of the window.
    """
    half = int(window_s / 2.0 / STEP_S) - 1
    turning = np.exp(-2j * np.pi * tone_hz * t_s)
    residual, _ = _without_constant(series[:, None], turning, hann(t_s, window_s))
    z, _, filled = averages(residual[:, 0] * turning, t_s, STEP_S, max(half, 0))
    if half < MIN_HALF:
        return TonePhase(np.zeros(z.size), filled)
    # The frequency may be that of a part: remove the mean rotation over the whole window.
    weights = _usual(half)[0] * filled
    step = np.angle(np.sum(np.sqrt(weights[1:] * weights[:-1]) * z[1:] * z[:-1].conj()))
    z = z * np.exp(-1j * step * np.arange(-half, half + 1))
    return TonePhase(np.asarray((z / (weights @ z / weights.sum())).imag, np.float64), filled)


def apart_hz2(series: Complex, chosen: int, t_s: Float, tone_hz: float, window_s: float) -> float:
    """Mean square disagreement of other series with one about a tone's frequency (Hz²).

    Ramps down the rows share the flicker, but not the leakage of overtones, their images and other
    lights. The error of a weaker series is scaled by its relative amplitude.

    Parameters
    ----------
    series : ndarray of complex, shape (frames, series)
    chosen : int
        Column that the frequency was read from.
    t_s : ndarray, shape (frames,)
        Times from the window's centre.
    tone_hz, window_s : float
        Frequency of the tone; length of the window.
    """
    weights = hann(t_s, window_s)
    turning = np.exp(-2j * np.pi * tone_hz * t_s)
    residual, amplitude = _without_constant(series, turning, weights)
    share = np.abs(amplitude) / np.maximum(np.abs(amplitude[chosen]), 1e-12)
    t_s = t_s - weights @ t_s
    bent = (weights * t_s * turning) @ residual
    slope_hz = (bent / (amplitude + 1e-12)).imag / (2.0 * np.pi * (weights @ t_s**2))
    others = (share > MIN_SHARE) & (np.arange(share.size) != chosen)
    if not others.any():
        return 0.0
    error_hz = np.minimum(share, 1.0) * (slope_hz - slope_hz[chosen])
    return float(np.mean(error_hz[others] ** 2))


def _without_constant(series: Complex, turning: Complex, weights: Float) -> tuple[Complex, Complex]:
    """Series less the constant fitted jointly with a tone, and the tone's amplitude in each."""
    overlap = weights @ turning
    mean, tone = weights @ series, (weights * turning) @ series
    orthogonal = max(1.0 - float(np.abs(overlap)) ** 2, 1e-12)
    amplitude = (tone - overlap * mean) / orthogonal
    return series - (mean - overlap.conjugate() * amplitude), amplitude


def averages(
    phasors: Complex, t_s: Float, step_s: float, half: int
) -> tuple[Complex, Float, NDArray[np.bool_]]:
    """Hann-weighted averages at ``−half … half`` steps.

    Parameters
    ----------
    phasors : ndarray of complex, shape (frames,)
    t_s : ndarray, shape (frames,)
        Times from the window's centre.
    step_s : float
        Time from one average to the next: half the length of a Hann window.
    half : int

    Returns
    -------
    values, mean times, whether well filled : ndarray, shape (2·half + 1,)
    """
    count = 2 * half + 1
    place = t_s / step_s + half
    before = np.floor(place).astype(np.int64)
    up = np.sin(0.5 * np.pi * (place - before)) ** 2
    index = np.concatenate((before, before + 1))
    weight = np.concatenate((1.0 - up, up))
    inside = (index >= 0) & (index < count)
    index, weight = index[inside], weight[inside]

    def total(values: Float) -> Float:
        return np.asarray(np.bincount(index, weight * np.tile(values, 2)[inside], count), float)

    filled = total(np.ones_like(t_s))
    usual = np.maximum(np.median(filled), 1e-9)
    safe = np.maximum(filled, 1e-9)
    z = np.asarray((total(phasors.real) + 1j * total(phasors.imag)) / safe, np.complex128)
    return z, total(t_s) / safe, np.asarray(filled >= 0.5 * usual)
