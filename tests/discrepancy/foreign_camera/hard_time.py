"""Files that are hard on estimators: other rates than the sensor's, and stamps that jump."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from .courses import wander
from .plan import Plan

EXACT = 1e-6  # frames
FILE_RATES = ("24000/1001", "24", "25", "30000/1001", "30")


def converted(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Drop or double frames, so that the file has another rate.

    Each shows the nearest in time, or the last whose time rounds to it, as FFmpeg does it.
    """
    at = _at(plan, rng)
    form = str(rng.choice(["nearest", "last"]))
    if form == "nearest":
        index = np.floor(at + 0.5).astype(int)
    else:
        index = (
            np.ceil(at + plan.sensor.frame_rate / plan.file_rate / 2 - 2 * EXACT).astype(int) - 1
        )
    index = np.minimum(index, len(plan.arrive) - 1)
    plan.arrive = plan.arrive[index]
    doubled = int((np.diff(index) == 0).sum())
    return {"file_rate": plan.file_rate, "doubled": doubled, "form": form}


def blended(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Mix the two nearest frames by their distance in time, so that the file has another rate."""
    at = _at(plan, rng)
    before = np.minimum(np.floor(at).astype(int), len(plan.arrive) - 2)
    plan.mix = plan.arrive[before + 1], np.minimum(at - before, 1.0)
    plan.arrive = plan.arrive[before]
    return {"file_rate": plan.file_rate}


def _at(plan: Plan, rng: np.random.Generator) -> np.ndarray:
    """Draw the file's rate; return where its frames stand between the sensor's."""
    rate = plan.sensor.frame_rate
    others = [other for name in FILE_RATES if abs((other := float(Fraction(name))) - rate) > 1e-3]
    plan.file_rate = float(rng.choice(others))
    count = int(len(plan.arrive) / rate * plan.file_rate + EXACT)
    plan.stamp_s = np.arange(count) / plan.file_rate
    return np.asarray(plan.stamp_s * rate + EXACT)


def stamp_jitter(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Give regular frames stamps that are off by `size` rms, but never out of order."""
    most_s = 0.45 / (plan.file_rate or plan.sensor.frame_rate)
    form = str(rng.choice(["normal", "uniform", "two values"]))
    count = len(plan.stamp_s)
    off = {
        "normal": rng.standard_normal(count),
        "uniform": rng.uniform(-(3**0.5), 3**0.5, count),
        "two values": rng.choice([-1.0, 1.0], count),
    }[form]
    plan.stamp_s = plan.stamp_s + np.clip(size * off, -most_s, most_s)
    return {"jitter_s": size, "form": form}


def true_variable_rate(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Begin frames at uneven times, which their stamps tell exactly; all are read equally long.

    The sensor's rate is the fastest.
    """
    form = str(rng.choice(["frame by frame", "slow", "now and then half"]))
    if form == "frame by frame":
        longer = rng.uniform(1.0, 1.0 + 2 * size, plan.frames)
    elif form == "slow":
        course = wander(rng, plan.start_s)
        longer = 1.0 + size * (course - course.min()) / 2
    else:
        dark = np.cumsum(rng.uniform(size=plan.frames) < 0.01) % 2
        longer = 1.0 + dark
    step_s = longer[:-1] / plan.sensor.frame_rate
    start_s = plan.start_s[0] + np.concatenate([[0.0], np.cumsum(step_s)])
    start_s = start_s[start_s <= plan.start_s[-1]]
    plan.start_s, plan.stamp_s = start_s, start_s - start_s[0]
    plan.readout_s, plan.arrive = plan.readout_s[: len(start_s)], np.arange(len(start_s))
    plan.file_rate = float((len(start_s) - 1) / plan.stamp_s[-1])
    return {"mean_rate": plan.file_rate, "form": form}
