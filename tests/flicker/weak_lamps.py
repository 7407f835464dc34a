"""Lamps of any strength before the foreign camera: even, with daylight, in shadows, or two of them.

Unlike its own cases the flicker is drawn from 0.02 to 3 %, and the noise so that it can be seen.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.discrepancy.foreign_camera.camera import take
from tests.discrepancy.foreign_camera.cases import START_S, Case, drawn_for, plan_of
from tests.discrepancy.foreign_camera.plan import Shining

ROWS, LEAST, MOST = 120, 2e-4, 3e-2
PACES = (
    *((50.0, f"{rate}") for rate in ("24000/1001", "24", "30000/1001", "30", "60000/1001", "60")),
    *((60.0, f"{rate}") for rate in ("25", "24", "50", "30000/1001", "24000/1001", "30")),
    (50.0, "25"),
)


def film(
    seed: int, *, flicker_ratio: float = 0.0, lamps: int = 0, pace: tuple[float, str] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float64], dict[str, Any]]:
    """Film one: levels (frames, rows, strips), times of frames, and the truth."""
    rng = np.random.default_rng([77, seed])
    drawn = PACES[rng.integers(len(PACES))]
    nominal_hz, rate = pace or drawn
    strips, seconds = int(rng.choice([4, 6, 8])), float(rng.uniform(12.0, 45.0))
    case = Case(
        seed=seed + 5000, duration_s=seconds, rows=ROWS, strips=strips, rate=rate,
        nominal_hz=nominal_hz,
    )  # fmt: skip
    plan, _ = plan_of(case)
    lamp, exposure_s = plan.lamps[0].lamp, plan.sensor.exposure_s
    drawn_ratio = float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST))))
    factor = (flicker_ratio or drawn_ratio) / abs(lamp.exposed(nominal_hz, exposure_s).first)
    factor = min(factor, 0.9 / float(np.abs(lamp.size).sum()))
    lamp = replace(lamp, size=lamp.size * factor)
    noise = float(10 ** rng.uniform(-2.3, -0.7))  # of a row of a strip, levels
    pixels = int(max(20, noise**-2.0))
    plan.sensor = replace(plan.sensor, pixels=pixels, row_noise_level=0.3 * noise)
    down, across = np.linspace(-1, 1, ROWS)[:, None], np.linspace(-1, 1, strips)[None]

    def edge(steep: float) -> NDArray[np.float64]:
        angle = rng.uniform(0, 2 * np.pi)
        slope = across * np.cos(angle) + down * np.sin(angle) - rng.uniform(-0.5, 0.5)
        return np.asarray(1.0 / (1.0 + np.exp(-steep * slope)))

    share, scene = np.ones((1, 1)), rng.integers(4)
    if scene == 1:  # daylight from one side
        share = np.clip(0.6 + 0.35 * rng.uniform(-1, 1) * across + 0.3 * down, 0.05, 1.0)
    if scene == 2:  # a shadow's edge
        share = 0.1 + 0.8 * edge(6.0)
    plan.lamps = [Shining(lamp=lamp, share=share)]
    count = lamps or 1 + int(rng.uniform() < 0.25)
    if count == 2:
        mixed = rng.uniform(0.2, 0.9) * edge(3.0)
        other = lamp.shifted(float(rng.choice([2.0, 4.0])) * np.pi / 3)
        plan.lamps = [
            Shining(lamp=lamp, share=share * (1 - mixed)),
            Shining(lamp=other, share=share * mixed),
        ]
    level = take(plan, drawn_for(case, "noise"))
    turns = plan.grid.turns(START_S + np.arange(int(plan.stamp_s[-1]) + 1))
    truth = {
        "enf_hz": np.diff(turns),
        "idle_ratio": plan.sensor.idle_ratio,
        "flicker_ratio": float(abs(lamp.exposed(nominal_hz, exposure_s).first)),
        "nominal_hz": nominal_hz,
        "lamps": count,
    }
    return level, plan.stamp_s, truth
