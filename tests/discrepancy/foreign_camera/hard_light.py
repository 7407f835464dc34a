"""Light that is hard on estimators: other harmonics, sources and tones than they expect."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .courses import stroll
from .light import Array, draw_lamp
from .odd_light import lit_window
from .plan import Moment, Plan, Shining, Tone

MOST_FLICKER = 0.4  # rms, of the light
PWM_HZ = (200.0, 217.0, 240.0, 250.0, 300.0, 400.0, 480.0, 500.0, 1000.0, 2000.0)
SLOW_MONITORS_HZ, FAST_MONITORS_HZ = (50.0, 49.95, 100.0), (60.0, 59.94, 59.95, 120.0)


def second_harmonic(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Make the second harmonic a fifth of `size` to twice as large, to the first, as rows show it.

    Its phase is any. The exposure is made short enough to show it.
    """
    ratio = size * float(np.exp(rng.uniform(np.log(0.2), np.log(2.0))))
    plan.expose(min(plan.sensor.exposure_s, 0.6 / (4 * plan.mains_hz)))
    _add_parts(plan, {4: ratio * np.exp(2j * np.pi * rng.uniform())})
    return {"second_ratio": ratio}


def half_wave_part(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let half waves differ: a part at the mains' own frequency, up to `size` to the first."""
    ratio = size * float(rng.uniform(0.05, 1.0))
    turns = np.exp(2j * np.pi * rng.uniform(size=2))
    third = float(rng.uniform(0.0, 0.3))
    _add_parts(plan, {1: ratio * turns[0], 3: third * ratio * turns[1]})
    return {"half_ratio": ratio, "third_half_ratio": third * ratio}


def _add_parts(plan: Plan, parts: dict[int, complex]) -> None:
    """Set parts of the first lamp, by order and relative to its first harmonic as rows show both.

    All of it is made weaker where that would be too much.
    """
    shining = plan.lamps[0]
    lamp = shining.lamp
    size = dict(zip(lamp.order.tolist(), lamp.size, strict=True))
    exposure_s, mains_hz = plan.sensor.exposure_s, plan.mains_hz
    first = lamp.first * np.sinc(2 * mains_hz * exposure_s)
    for order, part in parts.items():
        size[order] = part * first / np.sinc(order * mains_hz * exposure_s)
    order = np.array(sorted(size))
    lamp = replace(lamp, order=order, size=np.array([size[n] for n in order.tolist()]))
    plan.lamps[0] = replace(shining, lamp=lamp)
    weaker = min(1.0, MOST_FLICKER / 2 / plan.flicker_rms)
    plan.lamps[0] = replace(shining, lamp=replace(lamp, size=lamp.size * weaker))


def several_sources(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Light the scene by two to four lamps on any phases, of any makes.

    What each is of the light differs over strips and, smoothly, over rows.
    """
    count = int(rng.integers(2, 5))
    first = plan.lamps[0].lamp
    lamps = [first, *(draw_lamp(rng) for _ in range(count - 1))]
    phases = rng.choice([0.0, 2 * np.pi / 3, -2 * np.pi / 3], count) + rng.normal(0, 0.2, count)
    row = np.linspace(-1.0, 1.0, plan.rows)[None, :, None]
    strip, tilt = rng.normal(0, 1.0, (count, 1, plan.strips)), rng.normal(0, 0.4, (count, 1, 1))
    share = np.exp(strip + tilt * row)
    share = share / share.sum(axis=0)
    plan.lamps = [
        Shining(lamp=lamp.shifted(phase - np.angle(lamp.first)), share=part)
        for lamp, phase, part in zip(lamps, phases, share, strict=True)
    ]
    return {
        "phases_rad": phases.tolist(),
        "weights": share.mean(axis=1).tolist(),
        "lamps": [lamp.kind for lamp in lamps],
    }


def pwm(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Add a light that is switched at a frequency of its own; `size` is its first harmonic.

    It is drawn between a fifth of that and all of it. A crystal holds the frequency to 50 ppm,
    an RC circuit to 3 % only, and wanders. The exposure is made short enough to show it.
    """
    form = str(rng.choice(["crystal", "crystal", "RC"]))
    off = rng.uniform(-50e-6, 50e-6) if form == "crystal" else rng.uniform(-0.03, 0.03)
    hz = float(rng.choice(PWM_HZ)) * (1 + float(off))
    plan.expose(min(plan.sensor.exposure_s, float(rng.uniform(0.1, 0.7)) / hz))
    duty, depth = rng.uniform(0.15, 0.85), size * np.exp(rng.uniform(np.log(0.2), 0.0))
    share = rng.uniform(0.4, 1.0, plan.strips)
    t_s = np.arange(-2.0, plan.start_s[-1] + 2.0, 0.05)
    wander = stroll(rng, t_s, 20.0, smooth_s=1.0) * (1.0 if form == "RC" else 0.0)
    phase_rad = float(rng.uniform(0, 2 * np.pi))
    wave = np.sin(np.pi * duty * np.arange(1, 7)) / np.arange(1, 7)
    before = depth / np.sinc(hz * plan.sensor.exposure_s) / wave[0]

    def course_of(order: int) -> Any:
        return lambda at_s: np.exp(1j * order * np.interp(at_s, t_s, wander))

    for order in range(1, 7):
        plan.tones.append(
            Tone(
                hz=order * hz,
                depth_ratio=float(before * wave[order - 1]),
                phase_rad=order * phase_rad,
                times_light=False,
                share=share,
                course=course_of(order),
            )
        )
    return {"pwm_hz": hz, "depth_ratio": float(depth), "duty_ratio": float(duty), "form": form}


def monitor(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Put a monitor into view, lit line after line at the other mains frequency, or near that.

    It is a third of `size` to all of it, relative to the lamp's flicker, in one part of the
    picture; strength as the rms over the whole of it.
    """
    rates_hz = FAST_MONITORS_HZ if plan.grid.nominal_hz == 50.0 else SLOW_MONITORS_HZ
    hz = float(rng.choice(rates_hz)) * (1 + float(rng.uniform(-30e-6, 30e-6)))
    lit, scans = lit_window(plan, rng), float(rng.choice([0.0, rng.uniform(-1.4, 1.4)]))
    parts = rng.uniform(0.3, 1.0, 4) / np.arange(1, 5) * np.exp(2j * np.pi * rng.uniform(size=4))
    parts = parts * np.sinc(hz * np.arange(1, 5) * plan.sensor.exposure_s)
    ratio = size * float(rng.uniform(0.3, 1.0))
    rms = np.sqrt(np.sum(np.abs(parts) ** 2) / 2 * np.mean(lit**2))
    scale = min(ratio * plan.flicker_rms / rms, 0.5 / np.abs(parts).sum())

    def lit_by(moment: Moment, level: Array) -> Array:
        turn = np.exp(2j * np.pi * (hz * moment.t_s - scans * moment.row))
        glow = sum(part * turn**order for order, part in enumerate(parts, 1))
        return np.asarray(level * (1 + scale * glow.real[:, :, None] * lit))

    plan.on_level.append(lit_by)
    return {"refresh_hz": hz, "flicker_share": float(scale * rms / plan.flicker_rms)}


def no_lamp(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Take the lamps away: the scene is in steady light, and there is no mains to find."""
    plan.lamps = []
    return {}
