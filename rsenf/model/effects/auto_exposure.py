"""A gain that hunts."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.model.effects.base import Run, SensorEffect
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import parameter
from rsenf.model.wander import wander


@dataclass(frozen=True, kw_only=True)
class AutoExposure(SensorEffect):
    """The camera's gain drifts slowly and at random, for whole frames.

    Every row of a frame is brighter or darker by the same share, texture and flicker alike, so the
    frame mean wanders at frequencies well below a hertz.
    """

    name = "auto_exposure"
    source = "control loops of cameras; 0.1 to 5 % in steady light"
    confused_with = ("interharmonic", "daylight")
    told_apart_by = "a gain keeps the relative flicker, light that is added doesn't"

    gain_ratio: float = parameter(0.002, "rms of the gain about 1", low=0, high=0.3)
    time_constant_s: float = parameter(2.0, "over which it forgets", low=0.02, high=600)

    def apply(self, light: LineLight, run: Run) -> None:
        """Multiply each frame's light."""
        gain = run.kept(lambda rng: wander(rng, run.frames, run.step_s, self.time_constant_s))
        light.scale(1 + self.gain_ratio * gain[light.number, None])
