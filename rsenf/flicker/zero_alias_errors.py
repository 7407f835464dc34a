"""Standard errors of the zero-alias fit when the residual is neither white nor random.

A codec, a shaken camera or motion leave residuals that are correlated over rows and time; the
white-noise formula would give much too small an error. Their effect on the flicker's own ramp is
invisible, since the fit takes it for flicker. It is measured on ramps nearby, without flicker.
"""

from __future__ import annotations

import numpy as np

from rsenf.flicker.zero_alias_fit import Point
from rsenf.flicker.zero_alias_rows import Float

NEAR_TURNS = np.array([-2.0, -1.75, -1.5, -1.25, -1.0, 1.0, 1.25, 1.5, 1.75, 2.0])
ASIDE_TURNS = np.array([0.75, 1.0, 1.25, 1.5, 2.0])
LEAST_TURNS = 0.5  # a slower ramp is hardly distinct from the gain
# A codec that delays changes affects the phase more than the visible residual: errors after x264 at
# 50 and 150 kbit/s are this many times what the residual alone would give.
HARM = 2.0
# Bins over which a codec's remains of one picture in the next are correlated.
SLOW_BINS = 8
# Blocks of residual that may be correlated, as their numbers over bins and over rows; one block of
# all bins, since a codec's effect on some rows may last as long as the clip.
BLOCKS = ((1, 12), (10, 12), (20, 12), (30, 24), (240, 12))


def explained(point: Point) -> float:
    """Share of the slow variation that the flicker explains; at most 1.

    The noise is taken as half of the mean squared difference between neighbouring bins.
    """
    data = point.data
    step = np.diff(point.residual, axis=0) ** 2 @ data.row_weight
    noise = 0.5 * step.mean() * data.weight.sum()
    total = data.power(data.value)
    return float((total - point.power) / max(total - min(noise, point.power), 1e-300))


def noise_ratio(point: Point) -> float:
    """Variance of the noise that acts on the phases, over that of white noise of the same power.

    The largest of three: of the residual along ramps nearby; along the flicker itself, where its
    modulus varies; and along ramps nearby that turn with the flicker, summed over several bins. 1
    unless they are larger than by chance.
    """
    data, residual = point.data, point.residual
    variance = point.power / data.freedom(0)
    turns = np.abs(point.flicker.turns + NEAR_TURNS)
    ramps = np.exp(-2j * np.pi * turns[turns > LEAST_TURNS, None] * data.place)
    seen = (residual * data.row_weight) @ ramps.T
    near = np.mean(np.abs(seen) ** 2 * data.weight[:, None]) / (variance * data.place.size)
    light = data.without_gain(point.flicker.light(point.waves, data.place))
    along = (light * residual) @ data.row_weight
    modulus = np.mean(along**2 * data.weight / (light**2 @ data.row_weight)) / variance
    chance = 2.0 * np.sqrt(2.0 / data.t_s.size)
    fast = 1.0 + HARM**2 * max(max(near, modulus) - 1.0 - chance, 0.0)
    turning = seen * (np.exp(-1j * point.flicker.phase_rad) * data.weight)[:, None]
    blocks = np.arange(0, data.t_s.size, SLOW_BINS)
    sums, weights = (np.add.reduceat(x, blocks) for x in (turning, data.weight))
    slow = np.mean(np.abs(sums) ** 2 / weights[:, None]) / (variance * data.place.size)
    slow_chance = chance * np.sqrt(SLOW_BINS)
    return float(max(fast, slow if slow > 1.0 + slow_chance else 1.0))


def standard_error(point: Point, covariance: Float, parameter: int, ratio: float) -> float:
    """Standard error of a parameter other than the phases.

    From the covariance, unless two others together are larger: how the parts of the residual that
    act on the parameter add up over blocks, and how they would act if the flicker's ramp were
    another.

    Parameters
    ----------
    point : Point
        Where the fit ended.
    covariance : ndarray
        Its covariance.
    parameter : int
        Place after the phases: 0 is ``q``, 1 is ``τ``, 2 is ``c_1``.
    ratio : float
        Of :func:`noise_ratio`, as included in the covariance.
    """
    bins = point.flicker.phase_rad.size
    white = float(np.sqrt(covariance[bins + parameter, bins + parameter]))
    inverse = covariance[bins + parameter] / point.noise_var
    acting = point.data.without_gain(point.slope()) * inverse[:bins, None]
    acting = acting + np.tensordot(inverse[bins:], point.columns(), 1)
    acting = point.data.weighted(point.data.without_texture(acting)) * point.residual
    blocks = max(_by_blocks(acting, *block) for block in BLOCKS)
    aside = _by_other_ramps(acting, point.data.place)
    beyond_white = max(HARM * (aside - white / np.sqrt(ratio)), 0.0)
    return float(max(white, np.hypot(blocks, beyond_white)))


def _by_blocks(acting: Float, over_bins: int, over_rows: int) -> float:
    bins, rows = acting.shape[:2]
    in_time = np.add.reduceat(acting, np.arange(0, bins, max(bins // over_bins, 1)), axis=0)
    blocks = np.add.reduceat(in_time, np.arange(0, rows, max(rows // over_rows, 1)), axis=1)
    return float(np.sqrt(np.sum(blocks**2)))


def _by_other_ramps(acting: Float, place: Float) -> float:
    angle = 2.0 * np.pi * ASIDE_TURNS[:, None] * place
    aside = np.sqrt(2.0) * np.concatenate([np.cos(angle), np.sin(angle)])
    return float(np.sqrt(np.mean((aside @ acting.sum(axis=0)) ** 2)))
