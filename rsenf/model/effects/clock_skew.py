"""Clock error of the camera."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.model.clip import Clip
from rsenf.model.effects.base import FrameEffect, Run
from rsenf.model.parameters import parameter


@dataclass(frozen=True, kw_only=True)
class ClockSkew(FrameEffect):
    """The camera's clock is fast (> 0) or slow by a constant relative error.

    A camera second is ``1 / (1 + clock_ppm·1e-6)`` true seconds: the true periods of frames, lines
    and exposures are shorter than their nominal ones by that factor, and the ENF reads low by it.
    """

    name = "clock_skew"
    source = "crystal oscillators, 10 to 100 ppm; 62 to 76 ppm measured on a GoPro"
    confused_with = ("variable_frame_rate", "grid frequency")
    told_apart_by = "a reference of the grid's frequency, or a second clock in the recording"
    not_hidden = "it needs a reference of the grid, and has cases of its own beside one"

    clock_ppm: float = parameter(30.0, "error of the clock, fast > 0", low=-1e4, high=1e4)

    def apply(self, clip: Clip, run: Run) -> None:
        """Change the rate of the clock."""
        clip.clock_factor *= 1 + self.clock_ppm * 1e-6
