"""Modulation of the light at a frequency that isn't a multiple of the mains."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import LightEffect, Run
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.effects.residue import Residue
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter

SLOWEST_DIMMER_HZ = 200.0  # IEEE Std 1789-2015


@dataclass(frozen=True, kw_only=True)
class Interharmonic(LightEffect):
    """The supply's voltage swings at a frequency between its harmonics, and the light with it.

    All light, flicker included, is multiplied by a slow cosine: a line at its own frequency with
    aliases at multiples of the frame rate, and weak sidebands about the flicker's lines.
    """

    name = "interharmonic"
    source = "IEC 61000-4-15 (flicker meter), 0.5 to 33 Hz and above; ripple control"
    confused_with = ("pwm_tone", "auto_exposure")
    told_apart_by = (
        "its alias is one of many: the phase ramp down the rows tells which; near 0 Hz only the "
        "side lines part it from a gain"
    )
    weakest = Weakest(2e-4, "depth_ratio")

    flicker_hz: float = parameter(
        8.8, "frequency of the light's swing", low=0.1, high=1000,
        fitting=Fitting(None, 1e-4),
    )  # fmt: skip
    depth_ratio: float = parameter(
        0.005, "amplitude over the mean light", low=0, high=0.5,
        fitting=Fitting(0.0, 0.002, turn="phase_rad"),
    )  # fmt: skip
    phase_rad: float | None = parameter(
        None, "at the first frame's start; None draws it", low=-7, high=7
    )

    @property
    def same_as(self) -> tuple[str, ...]:
        """At high frequencies, a dimmer that switches all of the light, its flicker included."""
        return ("pwm_tone",) if self.flicker_hz >= SLOWEST_DIMMER_HZ else ()

    def apply(self, light: LineLight, run: Run) -> None:
        """Multiply by the modulation, with a random phase unless one is given."""
        phase_rad = self.phase_rad
        if phase_rad is None:
            phase_rad = float(run.rng().uniform(-math.pi, math.pi))
        light.scale(1 + np.float32(self.depth_ratio) * light.tone(self.flicker_hz, phase_rad))

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """The tone that stands out, at its possible aliases."""
        meta = cls.__dataclass_fields__["flicker_hz"].metadata
        return [{"flicker_hz": f} for f in residue.tones_hz if meta["low"] <= f <= meta["high"]]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the frequency and the phase, too."""
        flicker_hz = hiding.tone_hz(1.5, 25.0)
        values = {"flicker_hz": flicker_hz, **super().hidden(hiding)}
        return values | {"phase_rad": hiding.phase_rad()}
