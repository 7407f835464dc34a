"""Initial values of the fit that separates texture and flicker.

From nothing: without texture and gain, a first harmonic lies in the plane of the cosine and the
sine of its ramp. The power of the data in that plane gives the ramp; and the points in the plane
lie on a circle, since the lamp's amplitude is constant, which gives the phases. Or from the fit of
a span that overlaps this one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsenf.flicker.zero_alias_fit import Flicker
from rsenf.flicker.zero_alias_rows import Complex, Float, RowLogs

TURNS = (0.2, 6.0)  # 120 Hz light at 24 frames a second is 5 turns a frame
TURNS_STEP = 0.05
PEAKS = 3
SHARE = 0.2  # of the highest peak; lower ones aren't tried
# A noise peak exceeds the mean noise power by less than this over the root of the bins.
CHANCE = 6.0
MIN_OVERLAP = 8  # bins
PHASES = 64  # tried for each bin


def starts(data: RowLogs) -> list[Flicker]:
    """Initial values to try, the most promising ramp first.

    Each ramp comes with two circles: the one that fits its points best, and its mirror image on
    the other side of them, since noise can bend a short arc the other way.
    """
    found: list[Flicker] = []
    if not data.power(data.value) > 0.0:
        return found
    for turns in _peaks(data):
        points = _plane(data, turns)
        centre, radius = _circle(points, data.weight)
        middle = np.average(points, weights=data.weight)
        for c in (centre, 2.0 * middle - centre):
            phase = np.unwrap(np.angle(points - c))
            found.append(Flicker(phase, turns, 0.0, np.array([radius + 0j]), np.empty(0)))
    return found


def continued(data: RowLogs, before: Flicker, before_t_s: Float) -> Flicker | None:
    """Initial values from the flicker of an earlier span; None if too little of it is in this one.

    A later bin has the phase at which this light differs least from its rows without texture.

    Parameters
    ----------
    data : RowLogs
    before : Flicker
        Fitted to the earlier span.
    before_t_s : ndarray, shape (bins,)
        Times of that span's bins, on the same clock.
    """
    old = data.t_s <= before_t_s[-1]
    if np.count_nonzero(old) < MIN_OVERLAP:
        return None
    phase = np.interp(data.t_s, before_t_s, before.phase_rad)
    flicker = replace(before, phase_rad=phase)
    light = data.without_gain(flicker.light(flicker.waves(data.t_s, data.place), data.place))
    texture = np.average((data.value - light)[old], axis=0, weights=data.weight[old])
    angle = np.linspace(0.0, 2.0 * np.pi, PHASES, endpoint=False)
    cycle = replace(flicker, phase_rad=angle, read_out_s=0.0)
    lights = data.without_gain(cycle.light(cycle.waves(angle, data.place), data.place))
    weighted = lights * data.row_weight
    misfit = np.sum(weighted * lights, axis=1) - 2.0 * (data.value - texture)[~old] @ weighted.T
    phase[~old] = angle[misfit.argmin(axis=1)]
    last = np.count_nonzero(old) - 1
    phase[last:] = np.unwrap(phase[last:])
    return flicker


def _plane(data: RowLogs, turns: float) -> Complex:
    """Each bin's point in the plane of a ramp: ``A·exp(jψ)`` less its mean, shape (bins,)."""
    seen, gram = _seen(data, turns)
    x, y = np.linalg.solve(gram, seen)
    return np.asarray(x - 1j * y)


def _power(data: RowLogs, turns: float) -> float:
    """Power of the data in the plane of a ramp."""
    seen, gram = _seen(data, turns)
    return float(np.sum(seen * np.linalg.solve(gram, seen) * data.weight))


def _seen(data: RowLogs, turns: float) -> tuple[Float, Float]:
    """Projection of each bin on cosine and sine of a ramp, (2, bins), and their Gram matrix."""
    angle = 2.0 * np.pi * turns * data.place
    ramp = data.without_gain(np.stack([np.cos(angle), np.sin(angle)]))
    weighted = ramp * data.row_weight
    return weighted @ data.value.T, weighted @ ramp.T


def _peaks(data: RowLogs) -> list[float]:
    """Ramps whose planes hold more power than noise would, the strongest first."""
    grid = np.arange(TURNS[0], TURNS[1], TURNS_STEP)
    power = np.array([_power(data, turns) for turns in grid])
    bins = data.t_s.size
    noise = 2 * bins * (data.power(data.value) - power.max()) / data.freedom(2 * bins)
    least = max(SHARE * power.max(), (1.0 + CHANCE / np.sqrt(bins)) * noise)
    inner = np.flatnonzero((power[1:-1] >= power[:-2]) & (power[1:-1] >= power[2:])) + 1
    ranked = sorted(inner, key=lambda k: -power[k])[:PEAKS]
    return [float(grid[k]) for k in ranked if power[k] > least]


def _circle(points: Complex, weight: Float) -> tuple[complex, float]:
    """Centre and radius of the circle through noisy points (Taubin (1991), IEEE PAMI 13, 1115)."""
    middle = np.average(points, weights=weight)
    x, y = (points - middle).real, (points - middle).imag
    z = x * x + y * y
    size = np.average(z, weights=weight)
    if size <= 0.0:
        return complex(middle), 0.0
    scaled = np.stack([(z - size) / (2.0 * np.sqrt(size)), x, y], axis=1)
    _, _, axes = np.linalg.svd(scaled * np.sqrt(weight)[:, None], full_matrices=False)
    a, b, c = axes[-1]
    a /= 2.0 * np.sqrt(size)
    a = a if abs(a) > 1e-9 / np.sqrt(size) else 1e-9 / np.sqrt(size)
    centre = complex(-b, -c) / (2.0 * a)
    radius = float(np.sqrt(np.average(np.abs(points - middle - centre) ** 2, weights=weight)))
    return complex(middle + centre), radius
