"""Separates texture from flicker whose alias is at or near 0 Hz.

At 25 frames/s under 50 Hz mains every frame begins at the same phase of the flicker, except for the
grid's slow deviation: a static picture and static flicker look alike, and a row's mean over time
holds both. They differ in that the deviation turns the flicker's phase, and all rows on one ramp
together. So texture, ramp, waveform and phases are fitted jointly (model and likelihood:
:mod:`rsenf.flicker.zero_alias_fit`, initial values: :mod:`rsenf.flicker.zero_alias_starts`). Where
the phase hardly turns they aren't identifiable, and the result says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.flicker.zero_alias_fit import (
    Flicker,
    Linearised,
    explained,
    noise_ratio,
    refine,
    standard_error,
)
from rsenf.flicker.zero_alias_rows import Float, row_logs
from rsenf.flicker.zero_alias_starts import continued, starts

MAX_BINS = 500
MIN_BINS, MIN_ROWS = 8, 16
HARMONICS = 8
STEPS = 12
# Least decrease of chi-squared by a further harmonic, of two parameters.
WORTH = 20.0
# Orders of a lamp's share that varies down the rows; largest residual power relative to without.
SHARES, SHARES_WORTH = 4, 0.7
# Largest residual power with light at half the phase, relative to without.
HALF_WORTH = 0.5
# Least range of the phase, largest error of the turns, and least SNR of the amplitude.
MIN_SPAN_RAD = 1.0
MAX_TURNS_STD = 0.02  # half a point of the idle period at 25 frames a second
MIN_AMPLITUDE_SNR = 8.0
SIMPLE = 0.1  # largest overtone, relative to the first harmonic, of nearly sinusoidal light
# Least share of the slow variation that one ramp must explain: as flicker; for any result.
MIN_EXPLAINED, HOPELESS = 0.9, 0.5
# No lamp has a larger first harmonic in the logarithm of its light.
MAX_AMPLITUDE = 5.0
# Standard errors from zero of a certain sign, and between two read-out times that agree.
SURE_SIGN, PLAUSIBLE = 5.0, 3.0
# Half a turn and less looks like drift: the waveform can absorb part of the ramp's change.
LEAST_TURNS = 0.75
CYCLE = 64  # phases over which a cycle's light is averaged
LIGHT_HZ, LIGHT_RATIO = 110.0, 0.1  # illumination frequency of either grid, and its tolerance
# Largest error of the amplitude of a continued flicker, relative to that of the span before.
WORSE = 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class ZeroAlias:
    """Flicker that hardly turns from frame to frame, separated from the texture.

    The mirror image (all phases and the ramp with reversed sign) fits equally well, except for
    ``read_out_s``: ``turns`` is given positive, and the frequency deviates with either sign,
    ``f_0 = f_alias ± ψ'/2π``, with minus for a read-out from the last row to the first.

    Parameters
    ----------
    turns, turns_std : float
        ``q``: turns of the first harmonic's phase down the rows of one frame, at the mean
        frequency; and its standard error.
    t_s : ndarray, shape (bins,)
        Times of the bins.
    phase_rad : ndarray, shape (bins,)
        Unwrapped phase of each bin, up to a constant, half a read-out after ``t_s``.
    phase_cov : ndarray, shape (bins, bins)
        Covariance of the phases.
    amplitude, amplitude_std : float
        Of the first harmonic in the logarithm of the light: relative to the mean where it is small.
    series : ndarray of complex, shape (harmonics,)
        All harmonics of the logarithm of the light, the first real.
    share : ndarray, shape (orders,)
        Chebyshev coefficients, from order 1, of the lamp's share in the light down the rows:
        daylight falls on some rows more than on others. Empty where it is uniform.
    read_out_s, read_out_std : float
        Signed read-out time, from the ramp's change with the frequency: negative where the mirror
        image is the right one. Seldom known well.
    explained : float
        Share of the variation, beyond a common gain and noise, that the flicker explains.
    noise_ratio : float
        Noise at the flicker over white noise of the same power; 1 for a clean recording.
    flicker : Flicker
        The fitted model.
    """

    turns: float
    turns_std: float
    t_s: Float
    phase_rad: Float
    phase_cov: Float
    amplitude: float
    amplitude_std: float
    series: NDArray[np.complex128]
    share: Float
    read_out_s: float
    read_out_std: float
    explained: float
    noise_ratio: float
    flicker: Flicker

    @property
    def span_rad(self) -> float:
        """Range of the phase."""
        return float(np.ptp(self.phase_rad))

    @property
    def is_flicker(self) -> bool:
        """Whether one ramp of constant modulus explains it, unlike drift, shake and noise."""
        known = self.amplitude > MIN_AMPLITUDE_SNR * self.amplitude_std
        return known and self.explained > MIN_EXPLAINED

    @property
    def determined(self) -> bool:
        """Whether it is flicker whose phase has turned enough to rely on its ramp.

        Ramp and phases together must cover a whole period, unless the light is nearly sinusoidal:
        part of a period fits any length.
        """
        known = self.turns_std < MAX_TURNS_STD
        seen_rad = self.span_rad + 2.0 * np.pi * self.turns
        is_simple = np.abs(self.series[1:]).max(initial=0.0) < SIMPLE * self.amplitude
        is_whole = is_simple or seen_rad > 2.0 * np.pi
        return self.is_flicker and known and self.span_rad >= MIN_SPAN_RAD and bool(is_whole)

    def texture(self, level: Float, weight: Float) -> Float:
        """Levels under the light's mean over a cycle; the mean over time covers phases unevenly.

        Parameters
        ----------
        level, weight : ndarray
            As given to :func:`separate`.

        Returns
        -------
        ndarray, shape (rows,) or (rows, strips)
        """
        flicker, rows = self.flicker, level.shape[1]
        weight = weight / weight.mean()
        place = (np.arange(rows) + 0.5) / rows
        light = flicker.light(flicker.waves(self.t_s, place), place)
        seen = np.average(np.exp(light), axis=0, weights=weight)
        order = np.arange(1, flicker.series.size + 1)
        cycle = np.exp(1j * order * np.linspace(0.0, 2.0 * np.pi, CYCLE, endpoint=False)[:, None])
        shares = flicker.shares(place)
        mean = np.mean(np.exp((cycle @ flicker.series).real[:, None] * shares), axis=0)
        steady = np.average(level, axis=0, weights=weight)
        return np.asarray((steady.T * (mean / seen)).T)

    @property
    def direction(self) -> int:
        """Direction of the read-out: 1 first row first, -1 last row first, 0 if unknown.

        Known if the sign of ``read_out_s`` is certain, and its size agrees with the ramp.
        """
        by_ramp_s = self.turns / LIGHT_HZ
        amiss_s = abs(abs(self.read_out_s) - by_ramp_s)
        sure = abs(self.read_out_s) > SURE_SIGN * self.read_out_std
        plausible = amiss_s < PLAUSIBLE * self.read_out_std + LIGHT_RATIO * by_ramp_s
        is_known = self.determined and self.turns > LEAST_TURNS and sure and plausible
        return int(np.sign(self.read_out_s)) if is_known else 0


def separate(
    level: NDArray[np.floating],
    t_s: NDArray[np.floating],
    weight: Float | None = None,
    before: ZeroAlias | None = None,
) -> ZeroAlias | None:
    """Separate texture and flicker.

    Parameters
    ----------
    level : ndarray, shape (bins, rows) or (bins, rows, strips)
        Mean levels of the rows, averaged over bins of 0.25 to 0.5 s; longer where the phase turns
        by less than about a radian in each. Strips are bands of columns with textures of their own
        under the same light.
    t_s : ndarray, shape (bins,)
        Mean time of the frames in each bin, increasing.
    weight : ndarray, shape (bins,), optional
        Frames in each bin.
    before : ZeroAlias, optional
        Of a span that begins earlier and overlaps this one. Its flicker is continued where that
        fits as well; a search from the start takes several times as long.

    Returns
    -------
    ZeroAlias or None
        None if nothing varies along a ramp, or not by a lamp's waveform.

    Raises
    ------
    UsageError
        For fewer than 8 or more than 500 bins, fewer than 16 rows, or arrays that don't fit.
    """
    rows = np.asarray(level, np.float64)
    rows = rows[:, :, None] if rows.ndim == 2 else rows
    time_s = np.asarray(t_s, np.float64)
    weight = np.ones(time_s.size) if weight is None else np.asarray(weight, np.float64)
    if (
        not MIN_BINS <= time_s.size <= MAX_BINS
        or len(rows) != time_s.size
        or weight.size != time_s.size
    ):
        raise UsageError(
            f"{len(rows)} bins of rows, {time_s.size} times and {weight.size} weights",
            f"as many of each, from {MIN_BINS} to {MAX_BINS}",
        )
    if rows.shape[1] < MIN_ROWS:
        raise UsageError(f"{rows.shape[1]} rows", f"a ramp shows on {MIN_ROWS} rows or more")
    data = row_logs(rows.mean(axis=2), time_s, weight)
    if before is not None and (start := continued(data, before.flicker, before.t_s)) is not None:
        found = _result(refine(data, start, STEPS))
        if found.determined and found.amplitude_std < WORSE * before.amplitude_std:
            return found
    tried = [refine(data, start, STEPS) for start in starts(data)]
    if not tried:
        return None
    best = min(tried, key=lambda p: p.power)
    point = refine(data, best.flicker.with_harmonics(2), STEPS)
    uneven = refine(data, point.flicker.with_share(SHARES), STEPS)
    if explained(uneven) < HOPELESS:
        return None
    point = _at_half(_with_share(_with_harmonics(point), uneven))
    plausible = 0.0 < point.flicker.series[0].real < MAX_AMPLITUDE
    return _result(point) if plausible else None


def _with_share(even: Linearised, uneven: Linearised) -> Linearised:
    """Let the lamp's share vary down the rows if that explains much more than harmonics do.

    Not if the noise is white without it, nor in place of harmonics, which it can imitate on a
    short ramp.
    """
    if noise_ratio(even) <= 1.0:
        return even
    uneven = _with_harmonics(uneven)
    return uneven if uneven.power < SHARES_WORTH * even.power else even


def _with_harmonics(point: Linearised) -> Linearised:
    """Add harmonics as long as each improves the fit."""
    for harmonics in range(point.flicker.series.size + 1, HARMONICS + 1):
        more = refine(point.data, point.flicker.with_harmonics(harmonics), STEPS)
        enough = point.power - more.power < WORTH * more.noise_var * noise_ratio(more)
        point = more
        if enough:
            break
    return point


def _at_half(point: Linearised) -> Linearised:
    """Take the light for the second harmonic of light at half the phase, if that explains more."""
    data, flicker = point.data, point.flicker
    half = replace(flicker, phase_rad=flicker.phase_rad / 2.0, turns=flicker.turns / 2.0)
    first = half.waves(data.t_s, data.place)[0]
    seen = data.centred(np.stack([first.real, -first.imag]))
    weighted = data.weighted(seen).reshape(2, -1)
    size = np.linalg.solve(weighted @ seen.reshape(2, -1).T, weighted @ point.residual.ravel())
    shift = float(np.arctan2(size[1], size[0]))
    order = np.arange(1, min(flicker.series.size, HARMONICS // 2) + 1)
    series = np.zeros(2 * order.size, np.complex128)
    series[0] = np.hypot(*size)
    series[1::2] = flicker.series[: order.size] * np.exp(-2j * shift * order)
    start = replace(half, phase_rad=half.phase_rad + shift, series=series)
    other = refine(data, start, STEPS)
    return other if other.power < HALF_WORTH * point.power else point


def _result(point: Linearised) -> ZeroAlias:
    """Refine with the noise that acts on the phases, and state the errors."""
    ratio = noise_ratio(point)
    point = refine(point.data, point.flicker, STEPS, ratio)
    flicker, data, covariance = point.flicker, point.data, point.covariance()
    bins = data.t_s.size
    return ZeroAlias(
        turns=flicker.turns,
        turns_std=standard_error(point, covariance, 0, ratio),
        t_s=data.t_s,
        phase_rad=flicker.phase_rad,
        phase_cov=covariance[:bins, :bins],
        amplitude=float(flicker.series[0].real),
        amplitude_std=standard_error(point, covariance, 2, ratio),
        series=flicker.series,
        share=flicker.share,
        read_out_s=flicker.read_out_s,
        read_out_std=standard_error(point, covariance, 1, ratio),
        explained=explained(point),
        noise_ratio=ratio,
        flicker=flicker,
    )
