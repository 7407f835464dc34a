"""Row banding: a fixed pattern of bright and dark rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import Run, SensorEffect
from rsenf.model.effects.hiding import Weakest
from rsenf.model.effects.residue import Residue
from rsenf.model.grid import FloatArray
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter


@dataclass(frozen=True, kw_only=True)
class RowBanding(SensorEffect):
    """The read-out adds something to each line, equal along the line.

    Either a constant, white down the frame: unlike texture it isn't lit, so each line's flicker is
    smaller or larger relative to its static level than its neighbours'. Or a gain that varies in
    time by one course for all lines, with a pattern of any shape.
    """

    name = "row_banding"
    source = "fixed-pattern noise of column-parallel converters (EMVA 1288, DSNU); 0.05 to 1 %"
    confused_with = ("texture", "daylight")
    told_apart_by = "light of another level: the pattern stays, texture follows"
    weakest = Weakest(0.003, "banding_ratio")

    banding_ratio: float = parameter(
        0.003, "rms over the mean level; of a course, over lines and time", low=0, high=0.2
    )
    offset_ratios: tuple[float, ...] = parameter(
        (), "exactly these shares of the mean level instead, one a line", low=-1, high=1,
        fitting=Fitting(0.0, 1e-3, each="line", rms="banding_ratio"),
    )  # fmt: skip
    gain_ratios: tuple[float, ...] = parameter(
        (), "of a course: the gain of each line, where the course is 1", low=-1, high=1,
        fitting=Fitting(0.0, 1e-3, each="line", free=True, rms="banding_ratio"),
    )  # fmt: skip
    course: tuple[float, ...] = parameter(
        (), "over time, of rms 1, one value a frame; none is a constant", low=-100, high=100
    )

    @property
    def not_fitted(self) -> tuple[str, ...]:
        """Parameter that a constant, or a course, doesn't use."""
        return ("offset_ratios",) if self.course else ("gain_ratios",)

    def apply(self, light: LineLight, run: Run) -> None:
        """Add the constant pattern, or multiply by the one that follows a course."""
        if self.course:
            if self.gain_ratios:
                pattern = run.given(self.gain_ratios, run.shutter.lines)
                light.scale(1 + run.given(self.course)[light.number][:, None] * pattern)
            return
        offset = run.kept(lambda rng: self._pattern(rng, run)).astype(np.float32)
        light.offset = offset if light.offset is None else light.offset + offset

    def _pattern(self, rng: np.random.Generator, run: Run) -> FloatArray:
        if self.offset_ratios:
            return run.mean_level * run.given(self.offset_ratios, run.shutter.lines)
        return self.banding_ratio * run.mean_level * rng.standard_normal(run.shutter.lines)

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """A constant, and the course that a pattern of the rows' gains follows."""
        course = residue.row_course
        return [{}, *([{"course": tuple(course.tolist())}] if course.size else [])]
