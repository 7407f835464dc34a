"""Summarises a residual for the effects of the catalogue, which derive initial values from it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.interpolate import make_smoothing_spline

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.forward_model import plan
from rsenf.discrepancy.measured import LINES
from rsenf.discrepancy.series import least
from rsenf.messages.schema import FloatArray
from rsenf.model.effects.search import ResidualFeatures

ComplexArray = NDArray[np.complexfloating]

STANDS_OUT = 25.0  # power of a spectral line over the median; of noise (Laplace) 2⁻²⁵ is above
ALIASES = 1  # alternatives on either side of the likeliest alias order
ALIKE_RAMPS = 3  # orders on either side at which a harmonic's residual may appear
PEAKS = 24  # largest number of peaks examined
SKIRT = 4  # half width of a peak, in bins of half the resolution
BIN_S, ALIKE = 1.0, 0.3  # bins of the lines' gains; least correlation of their pattern
FASTEST_PER_S = 5.0  # change of a read-out's course of rms 1; what jumps is in the picture
ALONE = 0.8  # least share of the gains' common variance that is one pattern's
NEAR_BINS = 2.0  # tolerance of a harmonic's frequency, in units of 1 / duration
ANY_LIGHT = 0.1  # tolerance of the ramp of any light, in turns over the picture
STILL = 0.5  # least relative size of a mains line after demodulation by the grid's phase


def features_of(fit: Fit) -> ResidualFeatures:
    """Summarise the residual of a fit."""
    data = fit.data
    turn = fit.jacobian.turn
    flicker = fit.flicker
    seen = data.level - fit.forward.wall.astype(np.float32)
    along, across = least(flicker, seen, (1, 2)), least(turn, seen, (1, 2))
    tones_hz, pattern = standing_out(fit)
    return ResidualFeatures(
        gap=fit.gap.value,
        comb=fit.gap.comb,
        turns_per_frame=2.0 * data.nominal_hz / float(data.frame_rate),
        angle_rad=np.arctan2(across, along),
        size_ratio=np.hypot(along, across),
        tones_hz=tones_hz,
        pattern=pattern,
        row_course=row_course(fit),
    )


def standing_out(fit: Fit) -> tuple[tuple[float, ...], tuple[float, float] | None]:
    """Frequencies of light that explain the strongest spectral line, else the stripes that do.

    The statistic is the two-dimensional cross-spectrum, over frames and lines, of both halves of
    the residual. The first axis gives the alias, the second, the phase ramp down the lines, its
    order. A ramp too fast for every second line makes the product of the halves negative. Harmonics
    of the mains are skipped; weaker lines are left for the next round. Light of a given alias can
    only have ramps that differ by the phase that one frame rate turns in a read-out time.

    Returns
    -------
    tones_hz : tuple of float
        The likeliest first; empty if no line stands out.
    pattern : tuple of float or None
        Stripes in the picture's height, and how many pass a place per second.
    """
    data, every = fit.data, fit.data.every(LINES)
    first = fit.residual[data.first].mean(axis=2)
    second = fit.residual[data.second].mean(axis=2)
    size = tuple(fft.next_fast_len(2 * n) for n in first.shape)
    down = np.fft.rfftfreq(size[1])  # turns per line of a half
    moved = fft.rfft2(second, s=size)
    if every > 1:  # shift the odd lines onto the even ones
        moved *= np.exp(-2j * np.pi * down / every).astype(np.complex64)
    power = (fft.rfft2(first, s=size) * moved.conj()).real
    folded = power < 0.0 if every > 1 else np.zeros(power.shape, bool)
    power[folded] *= -1.0
    limit = STANDS_OUT * float(np.median(np.abs(power)))
    rate_hz, shutter = float(data.frame_rate), fit.forward.model.shutter
    for _ in range(PEAKS):
        n, i = np.unravel_index(int(np.argmax(power)), power.shape)
        if power[n, i] < limit:
            break
        alias_hz = _between(power[:, i], int(n)) * rate_hz / size[0]
        turns, exact = float(down[i]), _between(power[n], int(i)) / size[1]
        if folded[n, i]:
            alias_hz, turns, exact = -alias_hz, 1.0 - turns, 1.0 - exact
        down_hz = turns * data.lines / every / shutter.read_out_time_s
        likely = round((down_hz - alias_hz) / rate_hz)
        near = sorted(range(likely - ALIASES, likely + ALIASES + 1), key=lambda m: abs(m - likely))
        found = tuple(dict.fromkeys(abs(alias_hz + m * rate_hz) for m in near))
        column = first @ np.exp(-2j * np.pi * down[i] * np.arange(first.shape[1]))
        column = column.conj() if folded[n, i] else column
        ramps = range(likely - ALIKE_RAMPS, likely + ALIKE_RAMPS + 1)
        if not any(_follows_mains(fit, column, alias_hz, m * rate_hz) for m in ramps):
            return found, _pattern(exact * data.lines / every, alias_hz, fit)
        power[np.arange(n - SKIRT, n + SKIRT + 1) % size[0]] = 0.0
    return (), None


def _pattern(ramp: float, alias_hz: float, fit: Fit) -> tuple[float, float] | None:
    """Stripes in the picture, and their least rate (1/s); None where the line may be light's."""
    shutter, rate_hz = fit.forward.model.shutter, float(fit.data.frame_rate)
    alias_hz = math.remainder(alias_hz, rate_hz)
    stripes = ramp - alias_hz * shutter.read_out_time_s  # lines are exposed in turn
    if abs(math.remainder(stripes, 1.0 - shutter.idle_ratio)) < ANY_LIGHT:
        return None
    return abs(stripes), -math.copysign(alias_hz, alias_hz * stripes)


def _follows_mains(fit: Fit, column: ComplexArray, alias_hz: float, away_hz: float) -> bool:
    """Whether a line is at a mains harmonic, and stands out as much without the grid's phase."""
    freq_hz = alias_hz + away_hz
    order = harmonic_of(fit, abs(freq_hz))
    if not order:
        return False
    time_s, course = fit.data.time_s, fit.forward.course
    wander_rad = np.interp(time_s, course.node_s, course.psi_rad)
    exact_hz = math.copysign(order * 2.0 * course.nominal_hz, freq_hz) - away_hz
    still = np.abs(np.exp(-2j * np.pi * alias_hz * time_s) @ column)
    angle = 2.0 * np.pi * exact_hz * time_s + math.copysign(order, freq_hz) * wander_rad
    return bool(np.abs(np.exp(-1j * angle) @ column) > STILL * still)


def row_course(fit: Fit) -> FloatArray:
    """Course over time of a pattern of the lines' gains, beyond what all lines have in common.

    The first principal component of the lines' gains in bins of a second. It must agree between the
    even and the odd frames, and explain nearly all that they have in common: a moving pattern has
    more components. Its course over the frames is smoothed by a spline, whose stiffness is found by
    generalised cross-validation (Craven, P. and Wahba, G. (1978), Numerische Mathematik 31).

    Returns
    -------
    ndarray (captured frames,)
        Of rms 1; empty if there is none, or if it jumps.
    """
    data, lit = fit.data, fit.jacobian.lit
    second = (data.time_s // BIN_S).astype(np.intp)
    gains = least(lit, fit.residual, (2,))
    maps = []
    for part in (0, 1):
        frames = np.arange(part, data.frames, 2)
        count = np.bincount(second[frames], minlength=second[-1] + 1)
        starts = np.searchsorted(second[frames], np.arange(count.size))
        if not count.all():
            return np.empty(0)
        binned = np.add.reduceat(gains[frames], starts, axis=0) / count[:, None]
        binned -= binned.mean(axis=1, keepdims=True)
        maps.append(binned - binned.mean(axis=0))
    found = slice(0, None, data.every(LINES))  # the other lines are held out
    left, _, right = np.linalg.svd((maps[0] + maps[1])[:, found], full_matrices=False)
    one, other = (left[:, 0] @ binned for binned in maps)
    shared, size = float(one @ other), float(np.linalg.norm(one) * np.linalg.norm(other))
    if shared < max(ALIKE * size, ALONE * float((maps[0] * maps[1]).sum())):
        return np.empty(0)
    pattern = right[0] - right[0].mean()
    _, once = np.unique(data.slot, return_index=True)
    course = make_smoothing_spline(data.time_s[once], gains[once, found] @ pattern)
    start_s = plan(fit.forward.model, data).start_s
    of_frames = course(start_s)
    of_frames = (of_frames - of_frames.mean()) / np.std(of_frames)
    jumps = np.abs(np.diff(of_frames) / np.diff(start_s)).max() > FASTEST_PER_S
    return np.empty(0) if jumps else of_frames


def harmonic_of(fit: Fit, freq_hz: float) -> float:
    """Order of the mains harmonic, integer or half-integer, at a light's frequency; 0 for none."""
    light_hz = 2.0 * fit.forward.course.grid().freq_hz
    mean_hz, width_hz = float(light_hz.mean()), float(np.ptp(light_hz))
    order = max(round(2.0 * freq_hz / mean_hz), 1) / 2.0
    near_hz = order * width_hz / 2.0 + NEAR_BINS / float(fit.data.time_s[-1])
    return order if abs(freq_hz - order * mean_hz) < near_hz else 0.0


def _between(power: FloatArray, at: int) -> float:
    """Position of a peak by parabolic interpolation, in bins."""
    a, b, c = (float(power[(at + k) % power.size]) for k in (-1, 0, 1))
    bend = a - 2.0 * b + c
    return at + (float(np.clip(0.5 * (a - c) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0)
