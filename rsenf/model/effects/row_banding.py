"""A fixed pattern of bright and dark rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.model.effects.base import Run, SensorEffect
from rsenf.model.effects.hiding import Weakest
from rsenf.model.grid import FloatArray
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter


@dataclass(frozen=True, kw_only=True)
class RowBanding(SensorEffect):
    """The read-out adds to every line a constant of its own, white down the frame.

    Unlike texture it isn't lit: the flicker doesn't modulate it, so each line's flicker is smaller
    or larger against its static level than that of its neighbours.
    """

    name = "row_banding"
    source = "fixed-pattern noise of column-parallel converters (EMVA 1288, DSNU); 0.05 to 1 %"
    confused_with = ("texture", "daylight")
    told_apart_by = "light of another level: the pattern stays, texture follows"
    weakest = Weakest(0.003, "banding_ratio")

    banding_ratio: float = parameter(0.003, "rms over the mean level", low=0, high=0.2)
    offset_ratios: tuple[float, ...] = parameter(
        (), "exactly these shares of the mean level instead, one a line", low=-1, high=1,
        fitting=Fitting(0.0, 1e-3, each="line", rms="banding_ratio"),
    )  # fmt: skip

    def apply(self, light: LineLight, run: Run) -> None:
        """Add the pattern, the same in every frame."""
        offset = run.kept(lambda rng: self._pattern(rng, run)).astype(np.float32)
        light.offset = offset if light.offset is None else light.offset + offset

    def _pattern(self, rng: np.random.Generator, run: Run) -> FloatArray:
        if self.offset_ratios:
            return run.mean_level * run.given(self.offset_ratios, run.shutter.lines)
        return self.banding_ratio * run.mean_level * rng.standard_normal(run.shutter.lines)
