"""Effects in level: gain, patterns over rows, curves, and what coding does to contrast."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .courses import drawn, hunting, linear, settling, steps, swing, unit, wander
from .light import Array
from .plan import Moment, Plan


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
    pattern = {
        "wave": lambda: np.sin(2 * np.pi * row / rng.uniform(8.0, plan.rows / 3)),
        "smooth": lambda: gaussian_filter1d(
            rng.standard_normal(plan.rows), plan.rows * rng.uniform(0.01, 0.08)
        ),
        "comb": lambda: np.where(row % int(rng.integers(3, 33)) == 0, 1.0, 0.0),
    }[shape]
    over_rows = unit(pattern())
    course, form = drawn(rng, plan.start_s, (linear, swing, settling, wander))
    grown = size * course

    def of_rows(moment: Moment, level: Array) -> Array:
        band = grown[moment.frame][:, None] * over_rows
        return np.asarray(level * (1 + band[:, :, None]))

    plan.on_level.append(of_rows)
    return {"banding_rms_ratio": size, "form": f"{shape}, {form}"}
