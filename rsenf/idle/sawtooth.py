"""Weighted prediction that drifts: the frame's mean ramps away, and a key frame brings it back.

An encoder that predicts each frame as the one before it times a factor (H.264's weighted
prediction) may follow the flicker with the factor and not find back: the picture's brightness
ramps by tens of levels until the next key frame resets it. Row levels then say more about the
encoder than about the light.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

RESET_LEVEL = 8.0  # a step of the frame's mean that is a reset: light doesn't do that
OVER_USUAL = 6.0  # and this many times larger than steps are on average
WARM_UP = 25  # steps before any is judged
MIN_RESETS = 2
MIN_RETURN = 0.5  # share of the resets that ramps have to make good for


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
        """Whether resets of one sign are made good for by ramps of the other."""
        resets = max(self._up, self._down)
        return (
            resets >= MIN_RESETS
            and resets >= 3 * min(self._up, self._down)
            and -self._drifted * np.sign(self._jumped) > MIN_RETURN * abs(self._jumped)
        )
