"""Variable frame rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.clip import Clip
from rsenf.model.effects.base import FrameEffect, Run
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.grid import FloatArray
from rsenf.model.parameters import parameter
from rsenf.model.wander import wander


@dataclass(frozen=True, kw_only=True)
class VariableFrameRate(FrameEffect):
    """The frame period wanders slowly and at random; the time per line doesn't change.

    The alias moves by ``f_0`` times the relative change. Correct time stamps show all of it; if
    they are regular instead, the ENF seems to move as the frame rate did.
    """

    name = "variable_frame_rate"
    source = "phones that lengthen frames in dim light; oscillators that warm up, 1e-6 to 1e-4"
    confused_with = ("clock_skew", "grid frequency")
    told_apart_by = "the stamps, or a reference of the grid's frequency"
    weakest = Weakest(1e-5)  # no size: its realised strength varies in a short clip

    rate_ratio: float = parameter(1e-5, "rms of the relative change", low=0, high=0.2)
    time_constant_s: float = parameter(10.0, "over which it forgets", low=0, high=3600)
    late_s: tuple[float, ...] = parameter(
        (), "frames begin exactly so late instead, one value each", low=-60, high=60
    )
    stamped: bool = parameter(True, "the stamps say so; else they run on evenly")

    def apply(self, clip: Clip, run: Run) -> None:
        """Sum the frame periods."""
        late_s = run.given(self.late_s) if self.late_s else self._late_s(run)
        clip.start_s = clip.start_s + late_s
        if self.stamped:
            clip.stamp_offset_s += late_s

    def _late_s(self, run: Run) -> FloatArray:
        change = wander(run.rng(), run.frames, run.step_s, self.time_constant_s)
        periods = np.maximum(self.rate_ratio * change, -0.9) * run.step_s
        return np.concatenate(([0.0], np.cumsum(periods)[:-1]))

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Set the relative change."""
        return {"rate_ratio": hiding.times * cls.weakest.change}
