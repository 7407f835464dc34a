"""Things in no catalogue, in the light: what shines on the scene, or is lit in it, does them.

All take a size that is the rms of what they do, relative to the flicker's.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .courses import stroll, swing, unit, wander
from .in_picture import paint
from .light import Array
from .plan import Moment, Plan, Shining


def pulsating_part(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A screen in view, whose film is now bright and now dark."""
    shots = np.cumsum(rng.uniform(0.4, 5.0, plan.frames))
    bright = rng.uniform(-1.0, 1.0, len(shots) + 1)
    shown = stroll(rng, plan.start_s, 0.5, smooth_s=0.1)
    window = lit_window(plan, rng)

    def share(moment: Moment) -> Array:
        shot = bright[np.searchsorted(shots, moment.start_s)]
        course = shot + 0.2 * shown[moment.frame]
        return np.asarray(course[:, None, None] * window)

    paint(plan, share, size * plan.flicker_rms)
    return {"flicker_share": size}


def rolling_bar(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A monitor in view, lit line after line at its own rate: bars roll over it."""
    mains_hz = [plan.alias_hz(order * plan.mains_hz) for order in range(9)]
    rates_hz = np.array([56.25, 59.94, 60.0, 66.0, 70.07, 72.0, 74.98, 85.01, 90.0, 119.88, 143.98])
    clear = [min(abs(plan.alias_hz(hz) - alias) for alias in mains_hz) > 0.3 for hz in rates_hz]
    hz = float(rng.choice(rates_hz[clear] if any(clear) else rates_hz + 0.7))
    window, scans = lit_window(plan, rng), rng.uniform(0.6, 1.4)
    parts = rng.uniform(0.2, 1.0, 3) * np.exp(2j * np.pi * rng.uniform(size=3))
    parts = parts * np.sinc(hz * np.arange(1, 4) * plan.sensor.exposure_s)

    def share(moment: Moment) -> Array:
        turn = np.exp(2j * np.pi * (hz * moment.t_s - scans * moment.row))
        glow = sum(part * turn**order for order, part in enumerate(parts, 1))
        return np.asarray(glow.real[:, :, None] * window)

    paint(plan, share, size * plan.flicker_rms)
    return {"flicker_share": size, "refresh_hz": hz}


def shadow_edge(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """The edge of a shadow that creeps over the picture, slanted between the strips."""
    at = rng.uniform(0.3, 0.7) + rng.uniform(0.1, 0.3) * unit(
        swing(rng, plan.start_s) + 0.3 * wander(rng, plan.start_s)
    )
    slant, soft = rng.uniform(-0.3, 0.3, plan.strips), rng.uniform(0.01, 0.1)

    def share(moment: Moment) -> Array:
        past = moment.row[None, :, None] - at[moment.frame][:, None, None] - slant
        return np.asarray(np.tanh(past / soft))

    paint(plan, share, size * plan.flicker_rms)
    return {"flicker_share": size}


def saw_gain(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Light that rises evenly and falls back at once, again and again, in its own time."""
    apart_s = rng.uniform(0.8, 4.0) * rng.uniform(0.7, 1.3, plan.frames + 8)
    falls_s = plan.start_s[0] - 1.0 + np.concatenate([[0.0], np.cumsum(apart_s)])

    def share(moment: Moment) -> Array:
        index = np.searchsorted(falls_s, moment.t_s) - 1
        since = (moment.t_s - falls_s[index]) / (falls_s[index + 1] - falls_s[index])
        return np.asarray(since[:, :, None])

    paint(plan, share, size * plan.flicker_rms)
    return {"flicker_share": size}


def two_levels(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Light that jumps between two levels, in the midst of frames, with time enough between."""
    apart_s = 0.15 + min(1.5, (plan.start_s[-1] - plan.start_s[0]) / 10)
    jumps_s = plan.start_s[0] + np.cumsum(0.15 + rng.exponential(apart_s, plan.frames))

    def share(moment: Moment) -> Array:
        return np.asarray((np.searchsorted(jumps_s, moment.t_s) % 2)[:, :, None] * 1.0)

    paint(plan, share, size * plan.flicker_rms)
    return {"flicker_share": size}


def flash_frames(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Flashes of a few milliseconds, now and then; rows exposed meanwhile are brighter."""
    count = max(3, int((plan.start_s[-1] - plan.start_s[0]) / 6.0))
    at_s = np.sort(rng.uniform(plan.start_s[0], plan.start_s[-1], count))
    bright, lasts_s = rng.uniform(0.5, 1.5, count), rng.uniform(0.002, 0.008)
    strips = rng.uniform(0.5, 1.0, plan.strips)

    def flash(moment: Moment) -> Array:
        lit = np.zeros_like(moment.t_s)
        end_s = moment.t_s[-1, -1] + 0.1
        for one_s, much in zip(at_s, bright, strict=True):
            if moment.start_s[0] - 0.1 < one_s < end_s:
                lit += much * np.exp(-(((moment.t_s - one_s) / lasts_s) ** 4))
        return np.asarray(lit[:, :, None] * strips)

    lit_share = 1.5 * lasts_s * count / (plan.start_s[-1] - plan.start_s[0])
    power = lit_share * np.mean(bright**2) * np.mean(strips**2)
    peak = size * plan.flicker_rms / float(np.sqrt(power))

    def flashed(moment: Moment, level: Array) -> Array:
        return np.asarray(level * (1 + peak * flash(moment)))

    plan.on_level.append(flashed)
    return {"flicker_share": size, "flashes": count, "peak_ratio": peak}


def thermal_harmonics(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A lamp that warms up: its harmonics after the first change in size and phase."""
    lamp = plan.lamps[0].lamp
    order = 2 * np.arange(2, 6)
    change = rng.uniform(0.3, 1.0, 4) * np.exp(2j * np.pi * rng.uniform(size=4)) / np.arange(1, 5)
    shown = np.sinc(order * plan.mains_hz * plan.sensor.exposure_s)
    change *= size * plan.flicker_rms / np.sqrt(np.sum(np.abs(change * shown) ** 2) / 2)
    t_s = plan.start_s
    course = unit(swing(rng, t_s) + 0.5 * wander(rng, t_s))

    def over_time(at_s: Array) -> Array:
        return np.asarray(np.interp(at_s, t_s, course))

    warmed = replace(lamp, order=order, size=change)
    plan.lamps.append(Shining(lamp=warmed, share=np.ones(1), course=over_time))
    return {"flicker_share": size}


def lit_window(plan: Plan, rng: np.random.Generator) -> Array:
    """Part of the picture, in one or two strips and a third of the rows, its edges soft."""
    row, strip = np.linspace(0, 1, plan.rows)[:, None], np.arange(plan.strips)
    at, height = rng.uniform(0.25, 0.75), rng.uniform(0.12, 0.25)
    lit = np.abs(strip - rng.integers(plan.strips)) <= rng.integers(2)
    return np.asarray(lit / (1 + ((row - at) / height) ** 12))
