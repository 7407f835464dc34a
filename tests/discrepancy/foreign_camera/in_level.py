"""Effects in level: gain, patterns over rows, curves, and what coding does to contrast."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .courses import drawn, hunting, linear, settling, steps, swing, unit, wander
from .light import Array
from .plan import Moment, Plan

FULL = 255.0


def auto_exposure(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let the gain of frames take a course."""
    course, form = drawn(rng, plan.start_s, (swing, steps, hunting, settling, wander))
    gain = np.exp(size * course)

    def of_frame(moment: Moment, level: Array) -> Array:
        return np.asarray(level * gain[moment.frame][:, None, None])

    plan.on_level.append(of_frame)
    return {"gain_rms_ratio": size, "form": form}


def row_banding(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let a pattern over rows, the same in all strips, grow or come and go."""
    shape = str(rng.choice(["wave", "smooth", "comb"]))
    row = np.arange(plan.rows)
    if shape == "wave":
        pattern = np.sin(2 * np.pi * row / rng.uniform(8.0, plan.rows / 3))
    elif shape == "smooth":
        wide = plan.rows * rng.uniform(0.01, 0.08)
        pattern = gaussian_filter1d(rng.standard_normal(plan.rows), wide)
    else:
        pattern = np.where(row % int(rng.integers(3, 33)) == 0, 1.0, 0.0)
    over_rows = unit(pattern)
    course, form = drawn(rng, plan.start_s, (linear, swing, settling, wander))
    grown = size * course

    def of_rows(moment: Moment, level: Array) -> Array:
        band = grown[moment.frame][:, None] * over_rows
        return np.asarray(level * (1 + band[:, :, None]))

    plan.on_level.append(of_rows)
    return {"banding_rms_ratio": size, "form": f"{shape}, {form}"}


def gamma(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Put a power law between light and level, which lifts the dark parts or lowers them."""
    exponent = float(rng.choice([size, 1 / size]))

    def power(level: Array) -> Array:
        return np.asarray(FULL * (np.clip(level, 0.0, None) / FULL) ** exponent)

    plan.curves.append(power)
    return {"exponent": exponent}


def gop_attenuation(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let the flicker be weaker in some frames of each group, as coding by groups makes it.

    In one form fine texture fades with it, a tenth as much.
    """
    period = int(rng.choice([6, 8, 10, 12, 15, 24, 30, 48, 60]))
    place = (np.arange(plan.frames) - int(rng.integers(period))) % period
    form = str(rng.choice(["dip at the key", "ever weaker", "slow return"]))
    if form == "dip at the key":
        weaker = size * (place == 0)
    elif form == "ever weaker":
        weaker = size * place / (period - 1)
    else:
        weaker = size * np.exp(-place / rng.uniform(1.0, 3.0))
    texture = 0.1 * float(rng.choice([0.0, 0.0, 1.0]))
    steady = plan.wall
    for curve in plan.curves:
        steady = curve(steady)
    fine = texture * (steady - gaussian_filter1d(steady, 4.0, axis=0))

    def of_group(moment: Moment, level: Array) -> Array:
        return np.asarray(level - weaker[moment.frame][:, None, None] * (level - steady + fine))

    plan.on_picture.append(of_group)
    return {
        "attenuation_ratio": size,
        "period_frames": period,
        "form": form,
        "texture_ratio": texture * size,
    }
