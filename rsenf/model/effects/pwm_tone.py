"""Ripple of a dimmer, driver or monitor, independent of the mains."""

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

LINES = range(1, 41)  # harmonics of pulses
LEAST_SOUGHT_HZ = 48.0  # of monitors; slower tones count as an interharmonic


@dataclass(frozen=True, kw_only=True)
class PwmTone(LightEffect):
    """The light contains a tone, or pulses, of a constant frequency.

    It has a line at its own frequency, with aliases at all distances of whole frame rates, which
    doesn't move when the grid's frequency does. It is invisible if the exposure is a whole number
    of its periods, and is taken for texture if it is a multiple of the frame rate. Pulses have
    lines at its multiples as well; if they switch all light off, the first has the amplitude
    ``2·sinc(duty)``.
    """

    name = "pwm_tone"
    source = "pulse-width dimming, 200 Hz to 25 kHz; monitors, 50 to 240 Hz; IEEE Std 1789-2015"
    confused_with = ("interharmonic", "harmonics")
    told_apart_by = (
        "its phase ramp down the rows tells its frequency up to aliases of the line rate"
    )
    weakest = Weakest(5e-4, "depth_ratio")

    tone_hz: float = parameter(
        1000.0, "frequency", low=20, high=50_000,
        fitting=Fitting(None, 1e-4),
    )  # fmt: skip
    depth_ratio: float = parameter(
        0.01, "amplitude of the first line over the mean light", low=0, high=2,
        fitting=Fitting(0.0, 0.002, turn="phase_rad"),
    )  # fmt: skip
    phase_rad: float | None = parameter(
        None, "at the first frame's start; None draws it", low=-7, high=7
    )
    duty_ratio: float | None = parameter(
        None, "share of a period that pulses are on, about its phase 0; None is a pure tone",
        low=0.01, high=0.99,
    )  # fmt: skip

    def apply(self, light: LineLight, run: Run) -> None:
        """Add the tone, with a random phase unless one is given."""
        phase_rad = self.phase_rad
        if phase_rad is None:
            phase_rad = float(run.rng().uniform(-math.pi, math.pi))
        for k, ratio in enumerate(self._lines(), 1):
            tone = light.tone(k * self.tone_hz, k * phase_rad)
            light.level = light.level + np.float32(self.depth_ratio * ratio) * tone

    def _lines(self) -> list[float]:
        """Amplitudes of the lines over the first one's: for a rectangle as ``sin(π·k·d)/k``."""
        duty = self.duty_ratio
        if duty is None:
            return [1.0]
        return [math.sin(math.pi * k * duty) / (k * math.sin(math.pi * duty)) for k in LINES]

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """The tone that stands out, at its possible aliases."""
        most_hz = cls.__dataclass_fields__["tone_hz"].metadata["high"]
        return [{"tone_hz": f} for f in residue.tones_hz if LEAST_SOUGHT_HZ <= f <= most_hz]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the frequency and the phase, too."""
        tone_hz = hiding.tone_hz(250.0, 2500.0)
        return {"tone_hz": tone_hz, **super().hidden(hiding), "phase_rad": hiding.phase_rad()}
