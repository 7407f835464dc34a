"""Effects in the picture: what moves in it, and how it moves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .camera import moment_of
from .courses import stroll, unit
from .light import Array
from .plan import Moment, Plan


def paint(plan: Plan, share: Callable[[Moment], Array], rms_ratio: float) -> float:
    """Brighten the picture by `share`, scaled to an rms relative to level; return the scale.

    What of it stands still isn't counted, since it can't be told from the wall.
    """
    some = moment_of(plan, np.unique(np.linspace(0, plan.frames - 1, 400).astype(int)))
    part = share(some)
    part = np.broadcast_to(part, (len(some.frame), *part.shape[1:]))
    scale = rms_ratio / float(np.sqrt(np.mean((part - part.mean(axis=0)) ** 2)))

    def painted(moment: Moment, level: Array) -> Array:
        return np.asarray(level * (1 + scale * share(moment)))

    plan.on_level.append(painted)
    return scale


def moving_object(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let something darker or brighter than the wall cross the picture now and then."""
    form = str(rng.choice(["passes by", "rises and falls", "paces"]))
    lasts_s = plan.start_s[-1] - plan.start_s[0]
    passes_s = plan.start_s[0] + lasts_s * (np.arange(3) + rng.uniform(0.3, 0.7, 3)) / 3
    takes_s, height = rng.uniform(1.5, 4.0, 3), rng.uniform(0.1, 0.4)
    middle, pace_hz, ahead = rng.uniform(0.3, 0.7), rng.uniform(0.05, 0.3), rng.uniform(0, 6.28)
    column = (np.arange(plan.strips) + 0.5) / plan.strips
    wide = 0.3 / plan.strips

    def covers(moment: Moment) -> Array:
        t_s = moment.start_s[:, None]
        there = np.zeros((len(t_s), plan.strips))
        rows = np.full(len(t_s), middle)
        if form == "paces":
            x = 0.5 + 0.45 * np.sin(2 * np.pi * pace_hz * t_s + ahead)
            there = np.exp(-(((x - column) / wide) ** 2) / 2)
        else:
            for at_s, takes in zip(passes_s, takes_s, strict=True):
                x = (t_s - at_s) / takes + 0.5
                there += np.exp(-(((x - column) / wide) ** 2) / 2)
        if form == "rises and falls":
            rows = middle + 0.25 * np.sin(2 * np.pi * pace_hz * t_s[:, 0] + ahead)
        body = 1 / (1 + ((moment.row - rows[:, None]) / height) ** 8)
        return np.asarray(body[:, :, None] * there[:, None, :])

    sign = float(rng.choice([-1.0, 1.0]))
    scale = paint(plan, covers, sign * size)
    return {"level_rms_ratio": size, "contrast_ratio": scale, "form": form}


def image_wobble(plan: Plan, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Let the picture shake up and down, also while a frame is read."""
    form = str(rng.choice(["hand", "sway", "vibration"]))
    t_s = np.arange(plan.start_s[0] - 1.0, plan.start_s[-1] + 1.0, 0.004)
    if form == "hand":
        course = stroll(rng, t_s, rng.uniform(0.1, 0.5), smooth_s=0.03)
    else:
        hz = rng.uniform(0.3, 2.0) if form == "sway" else rng.uniform(3.0, 11.0)
        bouts = 1 + 0.3 * stroll(rng, t_s, 5.0, smooth_s=0.5)
        course = unit(bouts * np.sin(2 * np.pi * hz * t_s + rng.uniform(0, 6.28)))

    def rows_lower(moment: Moment) -> Array:
        return size * np.asarray(np.interp(moment.t_s, t_s, course))

    plan.shift_rows = rows_lower
    return {"wobble_rms_rows": size, "form": form}
