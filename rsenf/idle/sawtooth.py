"""Detects drifting weighted prediction: the frame's mean ramps away, and key frames reset it.

An encoder that predicts each frame as the one before it times a factor (H.264's weighted
prediction) may follow the flicker with the factor and not return: the picture's brightness ramps by
tens of levels until the next key frame resets it. Row levels then depend more on the encoder than
on the light.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

RESET_LEVEL = 8.0  # least step of the frame's mean at a reset: light doesn't jump like that
OVER_USUAL = 6.0  # and its least ratio to the mean step
WARM_UP = 25  # steps before any is judged
MIN_RESETS = 2
MIN_RETURN = 0.5  # least share of the resets that ramps compensate


class Sawtooth:
    """Watches the frame means of a stream."""

    def __init__(self) -> None:
        self._last = float("nan")
        self._steps, self._travelled = 0, 0.0
        self._up, self._down = 0, 0
        self._jumped, self._drifted = 0.0, 0.0

    def add(self, mean_level: Float) -> None:
        """Add frame means, in order."""
        for level in mean_level.tolist():
            step = level - self._last
            self._last = level
            if math.isfinite(step):
                self._take(step)

    def _take(self, step: float) -> None:
        usual = self._travelled / max(self._steps, 1)
        self._steps += 1
        self._travelled += abs(step)
        if abs(step) > RESET_LEVEL and self._steps > WARM_UP and abs(step) > OVER_USUAL * usual:
            self._up, self._down = self._up + (step > 0), self._down + (step < 0)
            self._jumped += step
        else:
            self._drifted += step

    @property
    def found(self) -> bool:
        """Whether ramps of one sign compensate resets of the other."""
        resets = max(self._up, self._down)
        return (
            resets >= MIN_RESETS
            and resets >= 3 * min(self._up, self._down)
            and -self._drifted * np.sign(self._jumped) > MIN_RETURN * abs(self._jumped)
        )
