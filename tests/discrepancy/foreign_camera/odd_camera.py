"""Things in no catalogue, in the camera: its mount, optics, sensor and processing do them.

All take a size that is about the rms of what they do, relative to the flicker's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import brentq

from .courses import linear, settling, stroll, swing, unit, wander
from .in_level import FULL
from .in_picture import paint
from .light import Array
from .plan import Moment, Plan
from .scene import draw_wall


def shake_with_gain(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A mount that shakes at 3 to 11 Hz: the picture moves under its vignette and tilts."""
    hz = rng.uniform(3.0, 11.0)
    t_s = np.arange(plan.start_s[0] - 1.0, plan.start_s[-1] + 1.0, 0.004)
    bouts = 1 + 0.4 * stroll(rng, t_s, 4.0, smooth_s=0.5)
    waver = 0.4 * stroll(rng, t_s, 4.0, smooth_s=0.5)
    course = unit(bouts * np.sin(2 * np.pi * hz * t_s + waver))
    tilt, strips = rng.uniform(0.5, 2.0), rng.uniform(0.4, 1.0, plan.strips)

    def share(moment: Moment) -> Array:
        at = np.interp(moment.t_s, t_s, course) * (1 + tilt * (2 * moment.row - 1))
        return np.asarray(at[:, :, None] * strips)

    paint(plan, share, size * plan.flicker_rms)
    rows = rng.uniform(0.02, 0.1)

    def rows_lower(moment: Moment) -> Array:
        return rows * np.asarray(np.interp(moment.t_s + 0.25 / hz, t_s, course))

    plan.shift_rows = rows_lower
    return {"flicker_share": size, "shake_hz": hz, "wobble_rms_rows": rows}


def knee(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Bright levels are pressed together above a knee."""
    at = float(np.quantile(plan.wall, rng.uniform(0.4, 0.8)))
    soft = rng.uniform(1.0, 8.0)

    def bend(level: Array) -> Array:
        return np.asarray(-soft * np.logaddexp(0.0, (level - at) / soft))

    return {"flicker_share": size, "knee_level": at, "bend": _bent(plan, bend, size)}


def s_curve(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A tone curve that is no power: one that steepens the middle, or one that rolls off."""
    if rng.uniform() < 0.5:
        form, over = "S", rng.uniform(0.8, 1.4)

        def bend(level: Array) -> Array:
            return np.asarray(-np.sin(2 * np.pi * over * level / FULL) * FULL / 8)

    else:
        form, over = "roll-off", rng.uniform(2.0, 5.0)

        def bend(level: Array) -> Array:
            return np.asarray(level / (1 + over * np.clip(level, 0, None) / FULL) - level)

    return {"flicker_share": size, "bend": _bent(plan, bend, size), "form": form}


def _bent(plan: Plan, bend: Callable[[Array], Array], size: float) -> float:
    """Add as much of a bend that the flicker's relative size varies by `size` over the wall."""
    level = plan.wall

    def varies(much: float) -> float:
        slope = 1 + much * (bend(level + 0.5) - bend(level - 0.5))
        relative = slope * level / (level + much * bend(level))
        return float(np.mean(relative.std(axis=0)) / relative.mean()) - size

    most = 0.8
    much = float(brentq(varies, 0.0, most)) if varies(most) > 0 else most
    plan.curves.append(lambda level: np.asarray(level + much * bend(level)))
    return much


def local_dimming(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Bands of rows whose gain a processor changes by small steps, each on its own."""
    zones = int(rng.integers(5, 12))
    zone = np.arange(plan.rows) * zones / plan.rows
    near = np.clip(1.5 - np.abs(zone[:, None] - np.arange(zones) - 0.5), 0.0, 1.0)
    gain = np.stack([stroll(rng, plan.start_s, rng.uniform(0.5, 3.0)) for _ in range(zones)])
    held = np.round(gain * 2) / 2

    def share(moment: Moment) -> Array:
        return np.asarray((held[:, moment.frame].T @ near.T)[:, :, None])

    paint(plan, share, size * plan.flicker_rms)
    return {"flicker_share": size, "zones": zones}


def burst_lines(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Rows are read in bursts, with pauses between."""
    late_s = size / (2 * np.pi * 2 * plan.mains_hz)  # rms
    line_s = plan.sensor.readout_s / plan.rows
    group = int(max(np.ceil(1.2 * late_s * np.sqrt(12) / line_s), rng.integers(8, 48)))
    saw = unit(-(np.arange(plan.rows) % group) / group)
    plan.late_s = plan.late_s + late_s * saw
    return {"flicker_share": size, "rows_at_once": group, "late_rms_s": late_s}


def black_drift(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """The level of black drifts, the same for bright and dark parts, with a wave over rows."""
    kind = (linear, settling, swing, wander)[int(rng.integers(4))]
    course = kind(rng, plan.start_s)
    level_rms = size * plan.flicker_rms * float(plan.wall.mean())
    tilt = rng.uniform(-0.5, 0.5)

    def darker(moment: Moment, level: Array) -> Array:
        offset = level_rms * course[moment.frame][:, None] * (1 + tilt * (2 * moment.row - 1))
        return np.asarray(level + offset[:, :, None])

    plan.on_level.append(darker)
    return {"flicker_share": size, "level_rms": level_rms, "form": kind.__name__}


def column_drift(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """The camera pans ever so slightly: other parts of the walls come into each strip."""
    beside = draw_wall(rng, plan.rows, plan.strips)
    other = np.log(gaussian_filter1d(beside, 3.0, axis=0) / plan.wall)
    other = other - other.mean(axis=0) + rng.uniform(-0.1, 0.1, plan.strips)
    kind = (linear, swing, wander)[int(rng.integers(3))]
    course = kind(rng, plan.start_s)

    def share(moment: Moment) -> Array:
        return np.asarray(course[moment.frame][:, None, None] * other)

    paint(plan, share, size * plan.flicker_rms)
    return {"flicker_share": size, "form": kind.__name__}


def frame_blend(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Every few frames, one is mixed with the one before."""
    period = int(rng.integers(3, 13))
    turned = abs(1 - np.exp(2j * np.pi * 2 * plan.mains_hz / plan.sensor.frame_rate))
    mixed = float(min(0.5, size * np.sqrt(period) / max(turned, 1e-3)))
    last: list[Array] = []

    def blend(moment: Moment, level: Array) -> Array:
        before = np.concatenate([last[0] if last else level[:1], level[:-1]])
        last[:] = [level[-1:].copy()]
        much = np.where(moment.frame % period == 0, mixed, 0.0)[:, None, None]
        return np.asarray(level + much * (before - level))

    plan.on_picture.append(blend)
    return {"flicker_share": size, "period_frames": period, "mixed_ratio": mixed}


def temporal_smoothing(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Noise reduction over frames: what changes little is smoothed, what changes more is not.

    It is stronger at some times than at others.
    """
    least = float(np.clip(1 - 12 * size, 0.3, 0.95))
    enough_level = 1.5 * plan.flicker_rms * float(plan.wall.mean())
    busy = 0.5 + 0.5 * np.tanh(wander(rng, plan.start_s))
    last: list[Array] = []

    def smooth(moment: Moment, level: Array) -> Array:
        kept = np.empty_like(level)
        held = last[0] if last else level[0]
        for index, picture in enumerate(level):
            change = picture - held
            share = np.minimum(np.abs(change) / enough_level, 1.0)
            weak = least + (1 - least) * busy[moment.frame[index]]
            held = held + (weak + (1 - weak) * share) * change
            kept[index] = held
        last[:] = [held]
        return kept

    plan.on_picture.append(smooth)
    return {"flicker_share": size, "least_gain": least}
