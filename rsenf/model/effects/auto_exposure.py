"""Automatic exposure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.model.effects.base import Run, SensorEffect
from rsenf.model.effects.hiding import Weakest
from rsenf.model.grid import FloatArray
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter
from rsenf.model.wander import wander


@dataclass(frozen=True, kw_only=True)
class AutoExposure(SensorEffect):
    """The camera's gain changes from frame to frame, by any course: drift, steps, oscillation.

    Every row of a frame is brighter or darker by the same factor, texture and flicker alike, so the
    frame mean fluctuates at frequencies well below a hertz.
    """

    name = "auto_exposure"
    source = "control loops of cameras; 0.1 to 5 % in steady light"
    confused_with = ("interharmonic", "daylight")
    told_apart_by = "a gain keeps the relative flicker, light that is added doesn't"
    weakest = Weakest(0.002, "gain_ratio")

    gain_ratio: float = parameter(0.002, "rms of the gain about 1", low=0, high=0.3)
    time_constant_s: float = parameter(2.0, "over which it forgets", low=0.02, high=600)
    gains: tuple[float, ...] = parameter(
        (), "exactly these relative changes instead, one a frame", low=-0.9, high=9,
        fitting=Fitting(
            0.0, 1e-3, each="frame", free=True, rms="gain_ratio", memory="time_constant_s"
        ),
    )  # fmt: skip

    def apply(self, light: LineLight, run: Run) -> None:
        """Multiply each frame's light."""
        light.scale(1 + run.kept(lambda rng: self._change(rng, run))[light.number, None])

    def _change(self, rng: np.random.Generator, run: Run) -> FloatArray:
        if self.gains:
            return run.given(self.gains)
        return self.gain_ratio * wander(rng, run.frames, run.step_s, self.time_constant_s)
