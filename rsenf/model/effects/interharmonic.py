"""A flicker that isn't a multiple of the mains."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rsenf.model.effects.base import LightEffect, Run
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import parameter


@dataclass(frozen=True, kw_only=True)
class Interharmonic(LightEffect):
    """The supply's voltage swings at a frequency between its harmonics, and the light with it.

    All light, flicker included, is multiplied by a slow cosine: a line at its own frequency with
    its aliases at whole frame rates, and weak side lines about the flicker's.
    """

    name = "interharmonic"
    source = "IEC 61000-4-15 (flicker meter), 0.5 to 33 Hz and above; ripple control"
    confused_with = ("pwm_tone", "auto_exposure")
    told_apart_by = (
        "its alias is one of many: the phase ramp down the rows tells which; near 0 Hz only the "
        "side lines part it from a gain"
    )

    flicker_hz: float = parameter(8.8, "frequency of the light's swing", low=0.1, high=1000)
    depth_ratio: float = parameter(0.005, "amplitude over the mean light", low=0, high=0.5)

    def apply(self, light: LineLight, run: Run) -> None:
        """Multiply by the swing; its phase at the start is drawn."""
        phase_rad = run.rng().uniform(-math.pi, math.pi)
        light.scale(1 + np.float32(self.depth_ratio) * light.tone(self.flicker_hz, phase_rad))
