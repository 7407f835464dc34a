"""Scenes that are hard on estimators: what moves as flicker does, and levels that jump."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .courses import stroll, unit, wander
from .light import Array
from .plan import Moment, Plan

STEP_S = 0.004


def stripes(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let periodic stripes move up or down: blinds, a conveyor, a railing one passes.

    Their contrast is a tenth of `size` to all of it; any speed and slant. Half of those that move
    evenly pass as often a second as the lamp's flicker would seem to.
    """
    form = str(rng.choice(["even", "even", "uneven", "to and fro"]))
    waves = float(np.exp(rng.uniform(np.log(1.5), np.log(60.0))))
    hz = float(np.exp(rng.uniform(np.log(0.05), np.log(40.0))))
    if form == "even" and rng.uniform() < 0.5:
        hz = abs(plan.alias_hz(2 * plan.grid.nominal_hz) + float(rng.uniform(-0.3, 0.3)))
    hz *= float(rng.choice([-1.0, 1.0]))
    slant = float(rng.choice([0.0, rng.uniform(-3.0, 3.0)]))  # periods over the picture's width
    contrast = size * float(np.exp(rng.uniform(np.log(0.1), 0.0)))
    parts = np.array([1.0, rng.uniform(0.0, 0.5), rng.uniform(0.0, 0.3)])
    parts = parts * np.exp(2j * np.pi * rng.uniform(size=3))
    order = np.arange(1, 4)
    if form != "to and fro":
        parts = parts * np.sinc(order * hz * plan.sensor.exposure_s)
    strip = (np.arange(plan.strips) + 0.5) / plan.strips
    parts_of = parts * np.sinc(order * slant / plan.strips)
    t_s = np.arange(plan.start_s[0] - 1.0, plan.start_s[-1] + 1.0, STEP_S)
    uneven = np.cumsum(0.1 * hz * wander(rng, t_s)) * STEP_S
    sways_hz, far = rng.uniform(0.1, 1.5), rng.uniform(0.2, 4.0)

    def periods(at_s: Array) -> Array:
        if form == "to and fro":
            return np.asarray(far * np.sin(2 * np.pi * sways_hz * at_s))
        more = np.interp(at_s, t_s, uneven) if form == "uneven" else 0.0
        return np.asarray(hz * at_s + more)

    def striped(moment: Moment, level: Array) -> Array:
        turn = np.exp(2j * np.pi * (waves * moment.row - periods(moment.t_s)))[:, :, None]
        turn = turn * np.exp(2j * np.pi * slant * strip)
        shown = sum(part * turn**n for n, part in zip(order.tolist(), parts_of, strict=True))
        return np.asarray(level * (1 + contrast * shown.real))

    plan.on_level.append(striped)
    return {
        "periods_a_picture": waves,
        "periods_a_second": hz if form != "to and fro" else None,
        "slant_periods": slant,
        "contrast_ratio": contrast,
        "form": form,
    }


def vibration(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Shake the picture up and down at 3 to 25 Hz, by a third of `size` to ten times, rows rms."""
    rows, hz = size * float(np.exp(rng.uniform(np.log(0.33), np.log(10.0)))), rng.uniform(3.0, 25.0)
    t_s = np.arange(plan.start_s[0] - 1.0, plan.start_s[-1] + 1.0, STEP_S)
    waver = rng.uniform(0.0, 1.0) * stroll(rng, t_s, 10.0, smooth_s=1.0)

    def rows_lower(moment: Moment) -> Array:
        angle = 2 * np.pi * hz * moment.t_s + np.interp(moment.t_s, t_s, waver)
        return np.asarray(rows * np.sqrt(2) * np.sin(angle))

    plan.shift_rows = rows_lower
    return {"shake_hz": float(hz), "wobble_rms_rows": rows}


def hand_tilt(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Film clouds of a wall from the hand, which tilts by a tenth of `size` rows to all, rms."""
    clouds = np.zeros((plan.rows, plan.strips))
    for share in (0.02, 0.06, 0.15):
        noise = rng.standard_normal((2 * plan.rows, plan.strips))
        some = gaussian_filter1d(noise, share * plan.rows, axis=0)[: plan.rows]
        clouds = clouds + rng.uniform(0.5, 1.0) * some / some.std()
    dark = plan.wall.mean() / plan.wall.max() * 0.8
    plan.wall = plan.wall.mean() * dark * np.exp(rng.uniform(0.03, 0.15) * clouds)
    rows = size * float(np.exp(rng.uniform(np.log(0.1), 0.0)))
    t_s = np.arange(plan.start_s[0] - 1.0, plan.start_s[-1] + 1.0, STEP_S)
    sway = stroll(rng, t_s, rng.uniform(0.3, 3.0), smooth_s=0.1)
    bouts = 1 + 0.5 * stroll(rng, t_s, 2.0, smooth_s=0.5)
    tremor = bouts * np.sin(2 * np.pi * rng.uniform(7.0, 12.0) * t_s)
    course = rows * unit(sway + rng.uniform(0.0, 0.05) * tremor)

    def rows_lower(moment: Moment) -> Array:
        return np.asarray(np.interp(moment.t_s, t_s, course))

    plan.shift_rows = rows_lower
    return {"tilt_rms_rows": rows}


def clouds(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let the light wander by up to `size`, as day does; it may as well be steady."""
    much = size * float(rng.choice([0.0, rng.uniform(0.1, 1.0)]))
    course = np.exp(much * wander(rng, plan.start_s))

    def lit(moment: Moment, level: Array) -> Array:
        return np.asarray(level * course[moment.frame][:, None, None])

    plan.on_level.append(lit)
    return {"gain_rms_ratio": much}


def gain_steps(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let the exposure's control step every few seconds, by up to `size` (log), within 0.1 to 1 s.

    Now the gain goes up, now down.
    """
    at_s = plan.start_s[0] + np.cumsum(rng.uniform(3.0, 9.0, 1 + int(plan.start_s[-1] / 3)))
    at_s = at_s[at_s < plan.start_s[-1]]
    values = np.concatenate([[0.0], -size * rng.uniform(0.2, 1.0, len(at_s))])
    values[::2] = 0.0
    width_s = rng.uniform(0.1, 1.0, len(at_s)) / 4
    rise = 0.5 + 0.5 * np.tanh((plan.start_s[:, None] - at_s) / width_s)
    gain = np.exp(rise @ np.diff(values))

    def of_frame(moment: Moment, level: Array) -> Array:
        return np.asarray(level * gain[moment.frame][:, None, None])

    plan.on_level.append(of_frame)
    return {"step_s": at_s.tolist(), "log_gain": values.tolist()}


def key_dimming(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let every so manieth picture be brighter or darker by up to `size`; it fades in a few."""
    period = int(rng.choice([10, 12, 15, 24, 25, 30, 50, 60]))
    much = size * float(rng.uniform(0.1, 1.0)) * float(rng.choice([-1.0, 1.0]))
    place = (np.arange(plan.frames) - int(rng.integers(period))) % period
    gain = 1 + much * np.exp(-place / rng.uniform(0.3, 4.0))

    def of_group(moment: Moment, level: Array) -> Array:
        return np.asarray(level * gain[moment.frame][:, None, None])

    plan.on_picture.append(of_group)
    return {"period_frames": period, "dimming_ratio": much}
