"""Physical programs that no catalogue has: each changes a plan and says what it did.

The truth of each has ``place`` (all names of a place in the chain that are right), ``form``
(``periodic``, ``drifting band``, ``event`` or ``clock``), ``hz`` and ``size_ratio`` where it has
them: the amplitude of the first line, before exposure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from .in_light import _beside
from .light import Array
from .plan import Moment, Plan, Tone


def _first_line(wave: Callable[[Array], Array]) -> float:
    """Amplitude of the first harmonic of a course over a turn."""
    turn = np.linspace(0.0, 2 * np.pi, 4096, endpoint=False)
    return float(2 * abs(np.mean(wave(turn) * np.exp(-1j * turn))))


def _rms(wave: Callable[[Array], Array]) -> float:
    turn = np.linspace(0.0, 2 * np.pi, 4096, endpoint=False)
    return float(np.std(wave(turn)))


def fan_shadow(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """The blades of a fan pass before the lamp, each with a soft shadow."""
    hz, angle = float(rng.uniform(2.5, 11.0)), float(rng.uniform(0, 6.28))
    sharp = float(rng.uniform(0.5, 4.0))

    def shade(turn: Array) -> Array:
        return np.asarray(np.exp(sharp * (np.cos(turn) - 1)))

    depth = size * plan.flicker_rms / _rms(shade)

    def shaded(moment: Moment, level: Array) -> Array:
        return np.asarray(
            level * (1 - depth * shade(2 * np.pi * hz * moment.t_s + angle))[:, :, None]
        )

    plan.on_level.append(shaded)
    return {
        "place": ["light"], "form": "periodic", "hz": hz, "size_ratio": depth * _first_line(shade)
    }  # fmt: skip


def dimmer_hunting(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A driver holds the mean light, but its ripple hunts in a limit cycle."""
    hz, angle = float(np.exp(rng.uniform(np.log(0.25), np.log(4.0)))), float(rng.uniform(0, 6.28))
    flat = float(rng.uniform(0.5, 3.0))

    def hunt(turn: Array) -> Array:
        return np.asarray(np.tanh(flat * np.sin(turn)))

    depth = size / _rms(hunt)
    first = plan.lamps[0]

    def course(t_s: Array) -> Array:
        return np.asarray(1 + depth * hunt(2 * np.pi * hz * t_s + angle))

    plan.lamps[0] = replace(first, course=course)
    return {
        "place": ["flicker"], "form": "periodic", "hz": hz, "size_ratio": depth * _first_line(hunt)
    }  # fmt: skip


def phone_vibrating(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A phone that lies beside the camera buzzes, and the picture with it."""
    hz, angle = float(rng.uniform(2.0, 11.0)), float(rng.uniform(0, 6.28))
    relative = plan.wall / plan.wall.mean(axis=0)
    steep = float(np.sqrt(np.mean(np.gradient(relative, axis=0) ** 2)))
    rows = size * plan.flicker_rms * 2**0.5 / steep

    def lower(moment: Moment) -> Array:
        return np.asarray(rows * np.sin(2 * np.pi * hz * moment.t_s + angle))

    plan.shift_rows = lower
    return {"place": ["picture"], "form": "periodic", "hz": hz, "size_ratio": None}


def led_wall(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A wall of LEDs, refreshed at a rate of its own, is seen in some rows."""
    hz = _beside(plan, rng, 45.0, min(180.0, 0.45 / plan.sensor.exposure_s))
    top = float(rng.uniform(0.0, 0.5))
    bottom = top + float(rng.uniform(0.25, 0.45))
    y = (np.arange(plan.rows) + 0.5) / plan.rows
    share = np.where((y > top) & (y < bottom), 1.0, 0.0)[:, None]
    depth = size * plan.flicker_rms * 2**0.5 / float(np.sqrt(np.mean(share**2)))
    before = depth / abs(np.sinc(hz * plan.sensor.exposure_s))
    for order, part in ((1, 1.0), (2, float(rng.uniform(0.0, 0.4)))):
        plan.tones.append(Tone(
            hz=order * hz, depth_ratio=before * part, phase_rad=float(rng.uniform(0, 6.28)),
            times_light=False, share=share,
        ))  # fmt: skip
    return {
        "place": ["added_light"], "form": "periodic", "hz": hz, "size_ratio": depth,
        "rows": [top, bottom],
    }  # fmt: skip


def condensation(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A patch of mist on the lens drifts over the picture."""
    first = float(rng.uniform(0.0, 1.0))
    moves = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 1.0))
    wide, length_s = float(rng.uniform(0.08, 0.25)), plan.start_s[-1] - plan.start_s[0]

    def mist(moment: Moment) -> Array:
        middle = first + moves * (moment.start_s - plan.start_s[0])[:, None] / length_s
        away = (moment.row - middle) / wide
        return np.asarray(np.exp(-(away**2) / 2))

    depth = size * plan.flicker_rms / 0.25

    def clouded(moment: Moment, level: Array) -> Array:
        return np.asarray(level * (1 - depth * mist(moment))[:, :, None])

    plan.on_level.append(clouded)
    return {
        "place": ["gain", "light"], "form": "drifting band", "speed_per_s": moves / length_s,
        "size_ratio": depth,
    }  # fmt: skip


def encoder_hunting(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """An encoder's rate control oscillates, and takes now more, now less of the flicker."""
    hz, angle = float(np.exp(rng.uniform(np.log(0.2), np.log(3.0)))), float(rng.uniform(0, 6.28))
    lean = float(rng.uniform(0.0, 0.8))

    def less(turn: Array) -> Array:
        return np.asarray(1 + np.sin(turn + lean * np.sin(turn)))

    depth = size / _rms(less)
    taken = depth * less(2 * np.pi * hz * (plan.start_s - plan.start_s[0]) + angle)
    steady = plan.wall

    def coded(moment: Moment, level: Array) -> Array:
        return np.asarray(level - taken[moment.frame][:, None, None] * (level - steady))

    plan.on_picture.append(coded)
    size_ratio = depth * _first_line(less) / (1 - depth)
    return {"place": ["coding"], "form": "periodic", "hz": hz, "size_ratio": size_ratio}


def warming_clock(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """The camera's crystal warms up, and its clock with it: only a reference shows it."""
    ppm, settles_s = 1000.0 * size * float(rng.choice([-1.0, 1.0])), float(rng.uniform(10.0, 40.0))
    t_s = plan.start_s - plan.start_s[0]
    plan.start_s = plan.start_s + 1e-6 * ppm * settles_s * (1 - np.exp(-t_s / settles_s))
    return {"place": [], "form": "clock", "size_ratio": None}


def missing_cycle(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """A cycle of the mains is missing now and then; the lamp's capacitor carries on for a while."""
    length_s = plan.start_s[-1] - plan.start_s[0]
    at_s = plan.start_s[0] + length_s * rng.uniform(0.05, 0.95, 3)
    falls_s, takes_s = float(rng.uniform(0.01, 0.06)), 1.0 / plan.grid.nominal_hz

    def dark(moment: Moment, level: Array) -> Array:
        dip = np.zeros_like(moment.t_s)
        for at in at_s:
            since = moment.t_s - at
            fallen = 1 - np.exp(-np.clip(since, 0.0, takes_s) / falls_s)
            dip += fallen * np.exp(-np.clip(since - takes_s, 0.0, None) / falls_s)
        return np.asarray(level * (1 - min(30 * size, 0.9) * dip)[:, :, None])

    plan.on_level.append(dark)
    return {
        "place": ["light"],
        "form": "event",
        "at_s": (at_s - plan.start_s[0]).tolist(),
        "size_ratio": None,
    }


PROGRAMS: tuple[Callable[[Plan, float, np.random.Generator], dict[str, Any]], ...] = (
    fan_shadow, dimmer_hunting, phone_vibrating, led_wall, condensation, encoder_hunting,
    warming_clock, missing_cycle,
)  # fmt: skip
