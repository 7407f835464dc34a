"""More physical programs that no catalogue has, and the truth of each as in `physical`.

A ``form`` may also be ``step`` (one ``at_s``), ``settling`` (``time_constant_s``) or ``other``.
``at_s`` are seconds from the film's first line. Where a change is uniform and no quicker than a
frame, light and gain do the same; where light is added once and briefly, light that is added or
multiplied does. Both are right then. Sizes are the rms over time, about each row's mean.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from .camera import moment_of
from .courses import stroll, unit
from .light import Array
from .physical import _first_line, _rms
from .plan import Moment, Plan

Shape = Callable[[Moment], Array]
MOST_ADDED, MOST_SAG = 1.0, 0.8


def _length_s(plan: Plan) -> float:
    return float(plan.start_s[-1] - plan.start_s[0])


def _depth(plan: Plan, size: float, shape: Shape) -> float:
    """By what a course in rows is multiplied to be `size` times the flicker, rms over time."""
    course = shape(moment_of(plan, np.arange(plan.frames)))
    return size * plan.flicker_rms / float(np.sqrt(course.var(axis=0).mean()))


def _add(plan: Plan, size: float, rng: np.random.Generator, shape: Shape) -> float:
    """Add light, which falls on some strips more than on others; return how much."""
    share = rng.uniform(0.5, 1.0, plan.strips)
    share = plan.wall * share / np.sqrt(np.mean(share**2))
    depth = min(_depth(plan, size, shape), MOST_ADDED)
    plan.on_level.append(lambda moment, level: level + depth * shape(moment)[:, :, None] * share)
    return depth


def _per_s(plan: Plan) -> float:
    """How quickly the flicker changes, rms."""
    parts = 2 * np.pi * plan.mains_hz * plan.seen.order * np.abs(plan.seen.size)
    return float(np.sqrt(np.sum(parts**2) / 2))


def _once(plan: Plan, rng: np.random.Generator, lower: float, upper: float) -> tuple[float, float]:
    after_s = _length_s(plan) * float(rng.uniform(lower, upper))
    return float(plan.start_s[0]) + after_s, after_s


def _slow_hz(rng: np.random.Generator, lower: float, upper: float) -> tuple[float, float]:
    return float(np.exp(rng.uniform(np.log(lower), np.log(upper)))), float(rng.uniform(0, 6.28))


def lightning(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """One to three lightnings behind a window, each of some quick strokes and a glow after."""
    after_s = _length_s(plan) * np.sort(rng.uniform(0.05, 0.95, int(rng.integers(1, 4))))
    exposure_s, strokes = plan.sensor.exposure_s, []
    for at in plan.start_s[0] + after_s:
        bright, later_s = float(rng.uniform(0.5, 1.0)), 0.0
        for _ in range(int(rng.integers(1, 6))):
            strokes.append((at + later_s, bright, float(rng.uniform(1e-3, 8e-3))))
            strokes.append((at + later_s, 0.3 * bright, float(rng.uniform(0.03, 0.15))))
            bright, later_s = bright * rng.uniform(0.4, 1.1), later_s + rng.uniform(0.03, 0.1)

    def flash(moment: Moment) -> Array:
        total = np.zeros_like(moment.t_s)
        for at, bright, falls_s in strokes:
            since = np.stack([moment.t_s - at - exposure_s / 2, moment.t_s - at + exposure_s / 2])
            left = np.exp(-np.clip(since, 0.0, None) / falls_s)
            total += bright * falls_s / exposure_s * (left[0] - left[1])
        return total

    _add(plan, size, rng, flash)
    return {
        "place": ["added_light", "light"], "form": "event", "at_s": after_s.tolist(),
        "size_ratio": None,
    }  # fmt: skip


def compressor_start(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A refrigerator's motor starts: the lamp sags, most while it runs up, and stays darker."""
    at_s, after_s = _once(plan, rng, 0.15, 0.85)
    falls_s, up_s = float(rng.uniform(0.06, 0.2)), float(rng.uniform(0.15, 0.6))
    inrush = float(rng.uniform(0.5, 4.0))

    def sag(moment: Moment) -> Array:
        since = np.clip(moment.t_s - at_s, 0.0, None)
        return np.asarray((1 - np.exp(-since / falls_s)) * (1 + inrush * np.exp(-since / up_s)))

    depth = min(_depth(plan, size, sag), MOST_SAG / (1 + inrush))
    plan.on_level.append(lambda moment, level: level * (1 - depth * sag(moment))[:, :, None])
    return {"place": ["light", "gain"], "form": "step", "at_s": [after_s], "size_ratio": depth}


def lamp_warming(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A lamp was just switched on: its ripple settles while its driver warms up."""
    begin_s, sign = plan.start_s[0], float(rng.choice([-1.0, 1.0]))
    settles_s = _length_s(plan) * float(np.exp(rng.uniform(np.log(0.08), np.log(0.7))))
    cold = np.exp(-(plan.start_s - begin_s) / settles_s)
    depth = sign * min(size / float(np.std(cold)), 0.9)
    plan.lamps[0] = replace(
        plan.lamps[0], course=lambda t_s: 1 + depth * np.exp(-(t_s - begin_s) / settles_s)
    )
    return {
        "place": ["flicker"], "form": "settling", "time_constant_s": settles_s, "size_ratio": depth
    }  # fmt: skip


def iris_hunting(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A lens's motor iris never rests: it opens and closes about its aim, evenly in between."""
    hz, angle = _slow_hz(rng, 0.2, 2.5)
    sharp = float(rng.uniform(0.5, 0.99))

    def open_(turn: Array) -> Array:
        return np.asarray(np.arcsin(sharp * np.sin(turn)))

    depth = size * plan.flicker_rms / _rms(open_)

    def let_in(moment: Moment, level: Array) -> Array:
        return level * (1 + depth * open_(2 * np.pi * hz * moment.t_s + angle))[:, :, None]

    plan.on_level.append(let_in)
    first = depth * _first_line(open_)
    return {"place": ["gain", "light"], "form": "periodic", "hz": hz, "size_ratio": first}


def train_passes(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A train passes the house: the tripod's shaking swells and fades, at no quite even pace."""
    hz, angle = float(rng.uniform(4.0, 11.0)), float(rng.uniform(0, 6.28))
    at_s, after_s = _once(plan, rng, 0.25, 0.75)
    wide_s = _length_s(plan) * float(rng.uniform(0.06, 0.2))
    t_s = np.arange(plan.start_s[0] - 1.0, plan.start_s[-1] + 1.0, 0.01)
    waver = float(rng.uniform(0.2, 1.2)) * stroll(rng, t_s, 2.0, smooth_s=0.3)

    def shake(moment: Moment) -> Array:
        turn = 2 * np.pi * hz * moment.t_s + np.interp(moment.t_s, t_s, waver) + angle
        return np.asarray(np.sin(turn) * np.exp(-(((moment.t_s - at_s) / wide_s) ** 2) / 2))

    relative = plan.wall / plan.wall.mean(axis=0)
    steep = float(np.sqrt(np.mean(np.gradient(relative, axis=0) ** 2)))
    rows = _depth(plan, size, shake) / steep
    plan.shift_rows = lambda moment: rows * shake(moment)
    return {
        "place": ["picture"], "form": "other", "hz": hz, "at_s": [after_s], "size_ratio": None
    }  # fmt: skip


def row_clock_spread(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """The clock of the rows is spread to radiate less: it runs up and down evenly, and slowly."""
    hz, angle = _slow_hz(rng, 0.2, 6.0)

    def ramp(turn: Array) -> Array:
        return np.asarray(np.arcsin(0.999 * np.sin(turn)))

    late_s = float(np.sqrt(np.mean((plan.line * plan.readout_s.mean()) ** 2)))
    depth = size * plan.flicker_rms / (_per_s(plan) * late_s * _rms(ramp))
    plan.readout_s = plan.readout_s * (1 + depth * ramp(2 * np.pi * hz * plan.start_s + angle))
    first = depth * _first_line(ramp)
    return {"place": ["read_out"], "form": "periodic", "hz": hz, "size_ratio": first}


def busy_processor(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A task of the camera's processor holds frames up now and again; the delay is worked off."""
    hz, angle = _slow_hz(rng, 0.15, 4.0)
    turns = hz * plan.start_s + angle / (2 * np.pi)
    late = unit(np.exp(-(turns % 1.0) / float(rng.uniform(0.15, 0.8))))
    plan.start_s = plan.start_s + size * plan.flicker_rms / _per_s(plan) * late
    return {"place": ["frame_time"], "form": "periodic", "hz": hz, "size_ratio": None}


def headlights(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A car turns outside, and the light of its lamps sweeps once over the picture."""
    at_s, after_s = _once(plan, rng, 0.2, 0.8)
    speed = float(rng.choice([-1.0, 1.0])) * _slow_hz(rng, 0.15, 1.5)[0]
    wide, second = float(rng.uniform(0.06, 0.3)), float(rng.uniform(0.3, 1.0))
    apart = wide * float(rng.uniform(1.0, 2.5))

    def beams(moment: Moment) -> Array:
        away = moment.row - 0.5 - speed * (moment.t_s - at_s)
        pair = np.exp(-(((away + apart / 2) / wide) ** 2) / 2)
        return np.asarray(pair + second * np.exp(-(((away - apart / 2) / wide) ** 2) / 2))

    depth = _add(plan, size, rng, beams)
    return {
        "place": ["added_light"], "form": "drifting band", "speed_per_s": speed,
        "at_s": [after_s], "size_ratio": depth,
    }  # fmt: skip


PROGRAMS: tuple[Callable[[Plan, float, np.random.Generator], dict[str, Any]], ...] = (
    lightning, compressor_start, lamp_warming, iris_hunting, train_passes, row_clock_spread,
    busy_processor, headlights,
)  # fmt: skip
