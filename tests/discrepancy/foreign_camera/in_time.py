"""Effects in time: when frames and rows are taken, which arrive, and what their stamps say."""

from __future__ import annotations

from typing import Any

import numpy as np

from .courses import drawn, linear, settling, swing, unit
from .light import Array
from .plan import Plan


def frame_drop(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Lose frames, singly or a few at once; the stamps of the others close up."""
    form = str(rng.choice(["single", "single", "several at once"]))
    at = _scattered(plan, size, rng)
    many = np.ones(len(at), dtype=int) if form == "single" else rng.integers(1, 4, len(at))
    lost = np.concatenate(
        [np.arange(begin, begin + count) for begin, count in zip(at, many, strict=True)]
    )
    plan.arrive = plan.arrive[~np.isin(plan.arrive, lost)]
    plan.stamp_s = plan.stamp_s[: len(plan.arrive)]
    before = np.cumsum(many) - many
    return {"at_frames": (at - before).tolist(), "frames_lost": many.tolist(), "form": form}


def capture_jitter(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Begin frames early or late, each on its own; their stamps don't say so."""
    late, form = _noise(plan.frames, rng)
    plan.start_s = plan.start_s + size * late
    return {"jitter_s": size, "form": form}


def readout_drift(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Read frames ever slower or faster."""
    course, form = drawn(rng, plan.start_s, (linear, settling, swing))
    plan.readout_s = plan.readout_s * (1 + size * course)
    return {"drift_rms_ratio": size, "form": form}


def _scattered(plan: Plan, per_minute: float, rng: np.random.Generator) -> Array:
    """Frames at least a second from the ends and from each other."""
    period_s = 1 / plan.sensor.frame_rate
    count = max(1, round(per_minute * plan.frames * period_s / 60.0))
    apart = max(4, min(round(1.0 / period_s), plan.frames // (3 * count + 3)))
    free = np.sort(rng.choice(plan.frames - (count + 1) * apart, count, replace=False))
    return np.asarray(free + apart * np.arange(1, count + 1))


def _noise(count: int, rng: np.random.Generator) -> tuple[Array, str]:
    """Independent values of mean zero and rms one, of a distribution drawn."""
    form = str(rng.choice(["normal", "laplace", "uniform", "two values", "rare"]))
    draw = {
        "normal": lambda: rng.standard_normal(count),
        "laplace": lambda: rng.laplace(size=count),
        "uniform": lambda: rng.uniform(-1, 1, count),
        "two values": lambda: rng.choice([-1.0, 1.0], count),
        "rare": lambda: rng.standard_normal(count) * np.where(rng.uniform(size=count) < 0.2, 4, 1),
    }[form]
    return unit(draw()), form
