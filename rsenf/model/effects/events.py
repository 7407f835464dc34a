"""Events at certain frames, for effects on delivery: drawing them, and finding phase jumps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.model.clip import Int64Array
from rsenf.model.effects.base import Run
from rsenf.model.effects.residue import Residue

LEAST_LEAP_RAD = 0.2  # smaller jumps can't be told from noise
MOST_RATIO = 0.05  # of the frames; more jumps mean that the model doesn't fit at all


def event_frames(per_min: float, at_frames: tuple[int, ...], run: Run) -> Int64Array:
    """Captured frames at which events occur, rising; never frame 0.

    Parameters
    ----------
    per_min : float
        Mean rate of events, which are equally likely in all frames.
    at_frames : tuple of int
        If any, exactly these frames, as far as the clip reaches.
    run : Run
        Of the effect.
    """
    if at_frames:
        frames = np.unique(np.array(at_frames, np.int64))
        return frames[(frames > 0) & (frames < run.frames)]
    chance = min(per_min * run.step_s / 60, 1.0)
    if not chance:
        return np.empty(0, np.int64)
    rng, numbers, last = run.rng(), [], 0
    while (last := last + int(rng.geometric(chance))) < run.frames:
        numbers.append(last)
    return np.array(numbers, np.int64)


def leaps(residue: Residue, turns: float) -> NDArray[np.int64]:
    """Frames at which the flicker's phase jumps ahead by a given amount, for good.

    Parameters
    ----------
    residue : Residue
    turns : float
        Size of the jump in periods, modulo 1.
    """
    step = 2.0 * np.pi * (turns - np.rint(turns))
    if abs(step) < LEAST_LEAP_RAD:
        return np.empty(0, np.int64)
    moved = np.diff(residue.angle_rad, prepend=residue.angle_rad[0])
    moved = np.angle(np.exp(1j * moved))
    near = np.abs(np.angle(np.exp(1j * (moved - step)))) < abs(step) / 4
    found = np.flatnonzero(near)
    return found if found.size < MOST_RATIO * near.size else np.empty(0, np.int64)
