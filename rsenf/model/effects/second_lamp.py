"""A second lamp on another phase of the mains."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import LightEffect, Run
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.effects.residue import Residue
from rsenf.model.lamp import LAMPS
from rsenf.model.light import Light
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter


@dataclass(frozen=True, kw_only=True)
class SecondLamp(LightEffect):
    """A second lamp, on another phase of the mains, lights part of the scene.

    The light of both adds. If their shares are equal all along a line, the sum is one lamp of
    another phase and depth; if they vary from left to right, so does the phase of the flicker. The
    lamp replaces a share ``weight`` of the light.
    """

    name = "second_lamp"
    source = "three-phase supply: light phases 2π/3 apart at the illumination frequency"
    confused_with = ("light phase", "flicker_ratio")
    told_apart_by = "strips from left to right; in row means alone it can't be seen"
    along_lines = True
    weakest = Weakest(0.02, "weight")

    weight: float = parameter(
        0.1, "its mean share of the light", low=0, high=1,
        fitting=Fitting(0.0, 0.02),
    )  # fmt: skip
    phase_rad: float = parameter(
        2 * math.pi / 3, "how far its first harmonic is ahead", low=-7, high=7,
        fitting=Fitting(None, 0.02),
    )  # fmt: skip
    lamp: str = parameter("same", "its kind", choices=("same", *LAMPS))
    tilt_ratio: float = parameter(
        1.0, "its share rises along a line by twice this, from 1 − tilt to 1 + tilt", low=-1, high=1
    )

    def apply(self, light: LineLight, run: Run) -> None:
        """Mix it in, more at one end of the lines than at the other."""
        f0_hz = 2 * light.grid.nominal_hz
        series = None if self.lamp == "same" else Light(lamp=self.lamp).series(f0_hz)
        change = np.float32(self.weight) * (light.lamp(self.phase_rad, series) - light.level)
        light.level = light.level + change
        if self.tilt_ratio:
            slope = np.float32(2 * self.tilt_ratio) * change
            light.slope = slope if light.slope is None else light.slope + slope

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """Phases in steps of π/3 without 0, where it would change nothing, and either side."""
        phases = (math.pi / 3, 2 * math.pi / 3, math.pi, -2 * math.pi / 3, -math.pi / 3)
        return [{"phase_rad": p, "tilt_ratio": tilt} for tilt in (1.0, -1.0) for p in phases]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw one of the other two phases of the supply."""
        phase_rad = hiding.sign() * 2.0 * math.pi / 3.0
        return {**super().hidden(hiding), "phase_rad": phase_rad}
