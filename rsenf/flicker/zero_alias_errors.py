"""What a fit may be wrong by, where the noise is neither white nor noise.

A codec, a shaken camera or something that moves leave traces that hang together over rows and
time; an error by the white noise's rule would be much too small. What they do to the ramp of the
flicker can't be seen, since the fit takes it for flicker. What they do to ramps nearby, where
there is no flicker, can.
"""

from __future__ import annotations

import numpy as np

from rsenf.flicker.zero_alias_fit import Fit, Point
from rsenf.flicker.zero_alias_rows import Float

NEAR_TURNS = np.array([-2.0, -1.75, -1.5, -1.25, -1.0, 1.0, 1.25, 1.5, 1.75, 2.0])
ASIDE_TURNS = np.array([0.75, 1.0, 1.25, 1.5, 2.0])
# Blocks of the residual that may hang together, as shares of the bins and of the rows.
BLOCKS = ((10, 12), (20, 12), (30, 24), (240, 12))


def noise_ratio(point: Point) -> float:
    """Noise where the flicker is over white noise of the same total power; at least 1.

    The larger of two: the residual along ramps nearby, and along the flicker itself, where its
    modulus isn't constant.
    """
    data, residual = point.data, point.residual
    turns = np.abs(point.flicker.turns + NEAR_TURNS)
    ramps = np.exp(-2j * np.pi * turns[turns > 0.5, None] * data.place)
    seen = np.einsum("irs,kr->iks", residual * data.row_weight, ramps)
    variance = point.power / data.freedom(0)
    white = variance * data.row_weight.sum(axis=0)
    near = np.mean(np.abs(seen) ** 2 * data.weight[:, None, None] / white)
    light = data.without_gain(point.flicker.light(point.waves)[:, :, None]) * data.row_weight
    along = np.einsum("irs,irs->i", light, residual)
    size = np.einsum("irs,irs->i", light, light / np.maximum(data.row_weight, 1e-12))
    modulus = np.mean(along**2 * data.weight / (size * variance))
    return float(max(1.0, near, modulus))


def standard_error(fit: Fit, parameter: int) -> float:
    """Standard error of one parameter that isn't a phase, by its place behind the phases.

    The largest of three: by the covariance; by how the parts of the residual that act on the
    parameter add up over blocks; and by how they would act on it were the flicker's ramp another.
    """
    point, bins = fit.point, fit.flicker.phase_rad.size
    inverse = fit.covariance[bins + parameter] / point.noise_var
    acting = point.data.without_gain(point.slope()[:, :, None]) * inverse[:bins, None, None]
    acting = acting + np.tensordot(inverse[bins:], point.columns(), 1)
    acting = point.data.weighted(point.data.without_texture(acting)) * point.residual
    found = [np.sqrt(fit.covariance[bins + parameter, bins + parameter])]
    found += [_by_blocks(acting, *block) for block in BLOCKS]
    return float(max([*found, _by_other_ramps(acting, point.data.place)]))


def _by_blocks(acting: Float, over_bins: int, over_rows: int) -> float:
    bins, rows = acting.shape[:2]
    in_time = np.add.reduceat(acting, np.arange(0, bins, max(bins // over_bins, 1)), axis=0)
    blocks = np.add.reduceat(in_time, np.arange(0, rows, max(rows // over_rows, 1)), axis=1)
    return float(np.sqrt(np.sum(blocks**2)))


def _by_other_ramps(acting: Float, place: Float) -> float:
    angle = 2.0 * np.pi * ASIDE_TURNS[:, None] * place
    aside = np.sqrt(2.0) * np.concatenate([np.cos(angle), np.sin(angle)])
    return float(np.sqrt(np.mean((aside @ acting.sum(axis=(0, 2))) ** 2)))
