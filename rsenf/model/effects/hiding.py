"""How an effect is hidden in a recording, for a blind test of whether it is found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

APART_HZ = 0.7  # a tone nearer to a multiple of the frame rate stands still in the picture
SEEN = 0.3  # of a tone, that the exposure must leave
FRAMES_APART = 40
NO_LIGHT = 0.25  # turns down the picture, from the ramp of any light


@dataclass(frozen=True)
class Weakest:
    """The weakest of an effect that is to be named, of rows of 60 s.

    Attributes
    ----------
    change : float
        Of ``size``, from neutral; events a minute; nothing for an effect that is there or isn't.
    size : str
        Parameter by which it is strong, to compare with what was found; empty for none.
    neutral : float
        Value of ``size`` with which it does nothing.
    """

    change: float = 0.0
    size: str = ""
    neutral: float = 0.0


@dataclass(frozen=True, eq=False)
class Hiding:
    """A clip to hide an effect in.

    Attributes
    ----------
    rng : Generator
    times : float
        Strength, over the weakest that is to be named.
    frames : int
    frame_rate : Fraction
    exposure_s : float
    idle_ratio : float
    """

    rng: np.random.Generator
    times: float
    frames: int
    frame_rate: Fraction
    exposure_s: float
    idle_ratio: float

    def sign(self) -> float:
        """Draw a direction: 1 or −1."""
        return float(self.rng.choice([-1, 1]))

    def phase_rad(self) -> float:
        """Draw a phase."""
        return float(self.rng.uniform(-math.pi, math.pi))

    def tone_hz(self, low_hz: float, high_hz: float) -> float:
        """Draw a tone that can be seen: by this shutter, at this frame rate."""
        while True:
            tone_hz = float(self.rng.uniform(low_hz, high_hz))
            from_multiple_hz = abs(math.remainder(tone_hz, float(self.frame_rate)))
            if abs(np.sinc(tone_hz * self.exposure_s)) > SEEN and from_multiple_hz > APART_HZ:
                return tone_hz

    def stripes(self, fewest: float, most: float) -> float:
        """Draw stripes in the picture's height, of a ramp that no light of their alias has."""
        apart = 1.0 - self.idle_ratio  # the turns in a read-out of one frame rate
        while True:
            stripes = float(self.rng.uniform(fewest, most))
            if abs(math.remainder(stripes, apart)) > min(NO_LIGHT, 0.4 * apart):
                return stripes

    def events(self, per_min: float) -> list[int]:
        """Draw frames, one at least, not at the ends and not close to each other."""
        count = max(round(per_min * self.frames / float(self.frame_rate) / 60.0), 1)
        places = np.arange(FRAMES_APART, self.frames - FRAMES_APART, FRAMES_APART)
        chosen = self.rng.choice(places, count, replace=False)
        chosen = chosen + self.rng.integers(0, FRAMES_APART // 2, count)
        return sorted(int(n) for n in chosen)
