"""What each effect needs for a search, and for a blind test of the search.

:class:`ResidualFeatures` sums up a residual, from which effects derive initial values.
:class:`Weakest` and :class:`Hiding` say how strongly, and with what random parameters, a blind test
hides an effect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from rsenf.model.grid import FloatArray

GROSS = 3e-3  # gap if lines have the wrong times: as small as this if the flicker stands still
NOTHING_FITS = 0.3  # gap above which hardly any flicker is explained
APART_HZ = 0.7  # nearer to a multiple of the frame rate a tone stands still in the picture
SEEN = 0.3  # least gain of the exposure at a tone
FRAMES_APART = 40
NO_LIGHT = 0.25  # distance from the ramp of any light, in turns over the picture


@dataclass(frozen=True, eq=False)
class ResidualFeatures:
    """Series and spectral lines of a residual."""

    # systematic power over the flicker's; about 1 or more if nothing fits, below zero if
    # neighbouring rows have opposite errors
    gap: float
    comb: float  # the same for rows two apart: exceeds the gap if errors alternate from row to row
    turns_per_frame: float  # periods of the light in a frame period
    # (frames,) phase by which each frame's flicker leads the model's, −π to π
    angle_rad: FloatArray
    size_ratio: FloatArray  # (frames,) amplitude of each frame's flicker over the model's
    # frequencies of light that explain the strongest spectral line, the likeliest first; mains
    # harmonics, including half orders, are excluded
    tones_hz: tuple[float, ...]
    # stripes in the picture's height and how many pass a place per second, which explain the
    # strongest line; None if light can
    pattern: tuple[float, float] | None = None
    # (captured frames,) course over time, of rms 1, that a pattern of the rows' gains follows;
    # empty if there is none
    row_course: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Weakest:
    """Least strength of an effect that must be found in 60 s of rows."""

    # of ``size`` from neutral, or events per minute; 0 for an effect that is only on or off
    change: float = 0.0
    size: str = ""  # parameter that is its strength, for comparison with the result; empty for none
    neutral: float = 0.0  # value of ``size`` at which it does nothing


@dataclass(frozen=True, eq=False)
class Hiding:
    """A clip to hide an effect in."""

    rng: np.random.Generator
    times: float  # strength over the weakest that must be found
    frames: int
    frame_rate: Fraction
    exposure_s: float
    idle_ratio: float

    def sign(self) -> float:
        """Draw a sign: 1 or −1."""
        return float(self.rng.choice([-1, 1]))

    def phase_rad(self) -> float:
        """Draw a phase."""
        return float(self.rng.uniform(-math.pi, math.pi))

    def tone_hz(self, low_hz: float, high_hz: float) -> float:
        """Draw a frequency within a range that this shutter and frame rate can show."""
        while True:
            tone_hz = float(self.rng.uniform(low_hz, high_hz))
            from_multiple_hz = abs(math.remainder(tone_hz, float(self.frame_rate)))
            if abs(np.sinc(tone_hz * self.exposure_s)) > SEEN and from_multiple_hz > APART_HZ:
                return tone_hz

    def stripes(self, fewest: float, most: float) -> float:
        """Draw a number of stripes in the picture's height whose ramp no light can have."""
        apart = 1.0 - self.idle_ratio  # periods of the frame rate in a read-out
        while True:
            stripes = float(self.rng.uniform(fewest, most))
            if abs(math.remainder(stripes, apart)) > min(NO_LIGHT, 0.4 * apart):
                return stripes

    def events(self, per_min: float) -> list[int]:
        """Draw at least one frame, none near the ends or near each other."""
        count = max(round(per_min * self.frames / float(self.frame_rate) / 60.0), 1)
        places = np.arange(FRAMES_APART, self.frames - FRAMES_APART, FRAMES_APART)
        chosen = self.rng.choice(places, count, replace=False)
        chosen = chosen + self.rng.integers(0, FRAMES_APART // 2, count)
        return sorted(int(n) for n in chosen)
