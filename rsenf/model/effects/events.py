"""Frames at which something happens now and then; shared by effects on delivery."""

from __future__ import annotations

import numpy as np

from rsenf.model.clip import Int64Array
from rsenf.model.effects.base import Run


def event_frames(per_min: float, at_frames: tuple[int, ...], run: Run) -> Int64Array:
    """Numbers of the captured frames at which it happens, in order; never frame 0.

    Parameters
    ----------
    per_min : float
        Events a minute, on average, each frame alike.
    at_frames : tuple of int
        If any, exactly these, as far as the clip reaches.
    run : Run
        Of the effect.
    """
    if at_frames:
        told = np.unique(np.array(at_frames, np.int64))
        return told[(told > 0) & (told < run.frames)]
    chance = min(per_min * run.step_s / 60, 1.0)
    if not chance:
        return np.empty(0, np.int64)
    rng, numbers, last = run.rng(), [], 0
    while (last := last + int(rng.geometric(chance))) < run.frames:
        numbers.append(last)
    return np.array(numbers, np.int64)
