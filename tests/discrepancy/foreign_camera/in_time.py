"""Effects in time: when frames and rows are taken, which arrive, and what their stamps say."""

from __future__ import annotations

from typing import Any

import numpy as np

from .courses import drawn, linear, settling, swing, unit, wander
from .light import Array
from .plan import Frames, Plan


def rows_cropped(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Keep some of the rows that are read only, from anywhere in the picture."""
    ratio = 1.0 - min(size, 0.8)
    begin = rng.uniform(0.0, 1.0 - ratio)
    plan.line = begin + ratio * plan.line
    return {"rows_ratio": ratio, "first_row_ratio": begin}


def interlace(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Take every other row half a frame later; each half is read in half the time."""
    top_first = bool(rng.uniform() < 0.5)
    half_s = 0.5 / plan.sensor.frame_rate
    plan.late_s = plan.late_s + half_s * ((np.arange(plan.rows) % 2) == (1 if top_first else 0))
    plan.readout_s = plan.readout_s / 2
    return {"field_delay_s": half_s if top_first else -half_s, "top_field_first": top_first}


def reverse_readout(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Read from the bottom to the top."""
    plan.line = plan.line[::-1].copy()
    return {}


def readout_drift(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Read frames ever slower or faster."""
    course, form = drawn(rng, plan.start_s, (linear, settling, swing))
    plan.readout_s = plan.readout_s * (1 + size * course)
    return {"drift_rms_ratio": size, "form": form}


def capture_jitter(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Begin frames early or late, each on its own; their stamps don't say so."""
    late, form = _noise(plan.frames, rng)
    plan.start_s = plan.start_s + size * late
    return {"jitter_s": size, "form": form}


def variable_frame_rate(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let the interval between frames vary slowly; the stamps tell a constant one."""
    course, form = drawn(rng, plan.start_s, (linear, swing, wander, _two_rates))
    period_s = 1 / plan.sensor.frame_rate
    late_s = size * period_s * (np.cumsum(course) - course)
    plan.start_s = plan.start_s + late_s
    return {"interval_rms_ratio": size, "late_rms_s": float(np.std(late_s)), "form": form}


def clock_skew(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let the camera's clock be fast or slow: its frames, its rows and its stamps go by it."""
    ppm = size * float(rng.choice([-1.0, 1.0]))
    slower = 1 / (1 + 1e-6 * ppm)
    plan.start_s = plan.start_s[0] + (plan.start_s - plan.start_s[0]) * slower
    plan.readout_s = plan.readout_s * slower
    return {"clock_ppm": ppm}


def frame_drop(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Lose frames, singly or a few at once; the stamps of the others close up."""
    form = str(rng.choice(["single", "single", "several at once"]))
    at = _scattered(plan, size, rng)
    many = np.ones(len(at), dtype=int) if form == "single" else rng.integers(1, 4, len(at))
    lost = np.concatenate([begin + np.arange(count) for begin, count in zip(at, many, strict=True)])
    plan.arrive = plan.arrive[~np.isin(plan.arrive, lost)]
    plan.close_up()
    before = np.cumsum(many) - many
    return {"at_frames": (at - before).tolist(), "frames_lost": many.tolist(), "form": form}


def frame_duplicate(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Repeat frames, between the others or in the place of the next."""
    form = str(rng.choice(["between", "between", "between", "in place"]))
    at = _scattered(plan, size, rng)
    if form == "in place":
        plan.arrive[at] = plan.arrive[at - 1]
    else:
        plan.arrive = np.insert(plan.arrive, at, plan.arrive[at - 1])
        plan.close_up()
        at = at + np.arange(len(at))
    return {"at_frames": at.tolist(), "form": form}


def timestamp_jitter(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Give regular frames stamps that are not."""
    wrong, form = _noise(len(plan.stamp_s), rng)
    plan.stamp_s = plan.stamp_s + size * wrong
    return {"jitter_s": size, "form": form}


def _scattered(plan: Plan, per_minute: float, rng: np.random.Generator) -> Frames:
    """Frames some way from the ends and from each other, a second where the film is that long."""
    period_s = 1 / plan.sensor.frame_rate
    count = max(1, round(per_minute * plan.frames * period_s / 60.0))
    apart = max(4, min(round(1.0 / period_s), plan.frames // (3 * count + 3)))
    free = np.sort(rng.choice(plan.frames - (count + 1) * apart, count, replace=False))
    return np.asarray(free + apart * np.arange(1, count + 1))


def _two_rates(rng: np.random.Generator, t_s: Array) -> Array:
    """Change between two values every few seconds."""
    return unit(np.sign(np.sin(2 * np.pi * t_s / rng.uniform(4.0, 20.0) + rng.uniform(0, 6.28))))


def _noise(count: int, rng: np.random.Generator) -> tuple[Array, str]:
    """Independent values of mean zero and rms one, of a distribution drawn."""
    form = str(rng.choice(["normal", "laplace", "uniform", "two values", "rare"]))
    if form == "laplace":
        values = rng.laplace(size=count)
    elif form == "uniform":
        values = rng.uniform(-1, 1, count)
    elif form == "two values":
        values = rng.choice([-1.0, 1.0], count)
    else:
        values = rng.standard_normal(count)
        if form == "rare":  # a fifth of them four times as large
            values = values * np.where(rng.uniform(size=count) < 0.2, 4.0, 1.0)
    return unit(values), form
