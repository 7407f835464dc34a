"""Effects in the light: harmonics, other lamps and tones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .courses import stroll
from .light import Array, draw_lamp
from .plan import Plan, Shining, Tone

BESIDE_HZ = 0.4  # of aliases that would hide a tone


def harmonics(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Add to the second harmonic of the first lamp, about in phase with what it has."""
    shining = plan.lamps[0]
    lamp = shining.lamp
    order, had = lamp.order.tolist(), lamp.size
    if 4 not in order:
        order, had = [*order, 4], np.append(had, 0j)
    shown = np.sinc(np.array([2, 4]) * plan.mains_hz * plan.sensor.exposure_s)
    second = had[order.index(4)]
    turn = rng.uniform(-0.8, 0.8) + np.angle(second) if second else rng.uniform(0, 2 * np.pi)
    added = size * abs(lamp.first * shown[0] / shown[1]) * np.exp(1j * turn)
    new = had + np.where(np.array(order) == 4, added, 0)
    plan.lamps[0] = replace(shining, lamp=replace(lamp, order=np.array(order), size=new))
    seen = dict(zip(order, np.abs(plan.seen.size / plan.seen.first), strict=True))
    return {
        "added_ratio": size,
        "second_ratio": float(seen[4]),
        "third_ratio": float(seen.get(6, 0.0)),
    }


def second_lamp(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let a lamp on another phase light some strips more than others, and none of one.

    The other hangs on another of the three phases, or behind a condenser; it is of the same make,
    or of another with the same first harmonic.
    """
    if plan.strips < 2:
        raise ValueError("a second lamp is seen between strips: at least two are needed")
    share = rng.uniform(0.0, 1.0, plan.strips)
    share[rng.permutation(plan.strips)[:2]] = 0.0, 1.0
    first = plan.lamps[0]
    form = str(rng.choice(["same make", "other make"]))
    lamp = first.lamp if form == "same make" else draw_lamp(rng)
    phase_rad = float(rng.choice([2 * np.pi / 3, -2 * np.pi / 3, rng.uniform(0.8, 2.2)]))
    turn = phase_rad + np.angle(first.lamp.first) - np.angle(lamp.first)
    lamp = replace(
        lamp.shifted(turn), size=lamp.shifted(turn).size * abs(first.lamp.first / lamp.first)
    )
    plan.lamps = [
        replace(first, share=first.share * (1 - size * share)),
        Shining(lamp=lamp, share=size * share),
    ]
    return {
        "weight": size,
        "phase_rad": phase_rad,
        "weights": (size * share).tolist(),
        "form": form,
    }


def exposure(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Expose longer or shorter."""
    plan.expose(min(6e-3, plan.sensor.exposure_s * float(np.exp(rng.uniform(-size, size)))))
    return {"exposure_s": plan.sensor.exposure_s}


def pwm_tone(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Dim the lamp by switching it quickly; the exposure is made short enough to show it."""
    lines_hz = plan.rows / plan.sensor.readout_s
    most_hz = min(5000.0, 0.4 * lines_hz)
    hz = _beside(plan, rng, 500.0, most_hz)
    plan.expose(min(plan.sensor.exposure_s, float(rng.uniform(0.1, 0.6)) / hz))
    form = str(rng.choice(["filtered", "square", "narrow pulse"]))
    ratio = {
        "filtered": [1.0],
        "square": [1.0, 0.0, 1 / 3],
        "narrow pulse": [1.0, 0.7, 0.4],
    }[form]
    before = size / abs(np.sinc(hz * plan.sensor.exposure_s))
    phase_rad = rng.uniform(0, 2 * np.pi)
    share = rng.choice([0.0, 1.0]) * rng.uniform(0.6, 1.0, plan.strips)
    share = share / share.max() if share.any() else np.ones(1)
    for order, part in enumerate(ratio, 1):
        if part and order * hz < 0.45 * lines_hz:
            angle = order * phase_rad + (rng.uniform(0, 6.28) if order > 1 else 0.0)
            plan.tones.append(
                Tone(hz=order * hz, depth_ratio=before * part, phase_rad=angle, share=share)
            )
    return {
        "tone_hz": hz,
        "depth_ratio": size,
        "strip_ratio": np.broadcast_to(share, plan.strips).tolist(),
        "overtones_ratio": ratio[1:],
        "form": form,
    }


def interharmonic(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let the supply swing at 0.5 to 25 Hz, or add the light of something else that flickers."""
    form = str(rng.choice(["steady swing", "wandering swing", "added tone"]))
    lower, upper = (26.0, 450.0) if form == "added tone" else (0.5, 25.0)
    upper = min(upper, 0.45 / plan.sensor.exposure_s)
    hz = _beside(plan, rng, lower, upper)
    before = size / abs(np.sinc(hz * plan.sensor.exposure_s))
    phase_rad = float(rng.uniform(0, 2 * np.pi))
    course = None
    if form == "wandering swing":
        t_s = np.arange(-2.0, plan.start_s[-1] + 2.0, 0.25)
        log_size, angle = (stroll(rng, t_s, 20.0, smooth_s=3.0) for _ in range(2))
        size_of = np.exp(0.2 * log_size + 0.3j * angle)
        size_of /= np.sqrt(np.mean(np.abs(size_of) ** 2))

        def course(at_s: Array) -> Array:
            return np.asarray(np.interp(at_s, t_s, size_of))

    tone = Tone(
        hz=hz,
        depth_ratio=before,
        phase_rad=phase_rad,
        times_light=form != "added tone",
        course=course,
    )
    plan.tones.append(tone)
    return {
        "flicker_hz": hz,
        "alias_hz": plan.alias_hz(hz),
        "depth_ratio": size,
        "form": form,
    }


def _beside(plan: Plan, rng: np.random.Generator, lower_hz: float, upper_hz: float) -> float:
    """Draw a frequency whose alias is neither steady nor that of the light's first harmonics."""
    taken = [plan.alias_hz(order * plan.mains_hz) for order in range(9)]
    taken += [plan.alias_hz(tone.hz) for tone in plan.tones]
    for _ in range(1000):
        hz = float(np.exp(rng.uniform(np.log(lower_hz), np.log(upper_hz))))
        if min(abs(plan.alias_hz(hz) - alias) for alias in taken) > BESIDE_HZ:
            return hz
    raise ValueError(f"no tone of {lower_hz:g} to {upper_hz:g} Hz stands beside the light's")
