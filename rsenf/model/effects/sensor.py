"""Effects of the sensor: automatic exposure, the tone curve, a pattern of bright and dark rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import Run, SensorEffect, ToneEffect
from rsenf.model.effects.search import ResidualFeatures, Weakest
from rsenf.model.grid import FloatArray
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter


@dataclass(frozen=True, kw_only=True)
class AutoExposure(SensorEffect):
    """The camera's gain changes from frame to frame, by any course: drift, steps, oscillation.

    Every row of a frame is brighter or darker by the same factor, ``1 + g_n``, texture and flicker
    alike, so the frame mean fluctuates at frequencies well below a hertz.
    """

    name = "auto_exposure"
    source = "control loops that move the gain (EMVA 1288, system gain); 0.1 to 5 % in steady light"
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
        gain = run.wandering(self.gains, self.gain_ratio, self.time_constant_s)
        light.scale(1 + gain[light.number, None])


@dataclass(frozen=True, kw_only=True)
class Gamma(ToneEffect):
    """Levels leave the camera by a power law, ``255 · (light / 255)^exponent``.

    The relative flicker is multiplied by the exponent, and a pure tone gets a second harmonic of
    ``(exponent − 1)/4`` times its relative size. Noise passes the same curve, so that its
    dependence on the level is no longer the sensor's.
    """

    name = "gamma"
    of_camera = True
    source = "ITU-R BT.709 and sRGB transfer curves; FFmpeg's eq filter"
    confused_with = ("harmonics",)
    told_apart_by = "noise against level, or flicker in bright against dark regions"
    weakest = Weakest(0.2, "exponent", 1.0)

    exponent: float = parameter(
        1.2, "of the power law", low=0.3, high=3.0, fitting=Fitting(1.0, 0.02)
    )

    def apply(self, exponent: float) -> float:
        """Multiply by its exponent: successive power laws are one."""
        return exponent * self.exponent


@dataclass(frozen=True, kw_only=True)
class RowBanding(SensorEffect):
    """The read-out adds something to each line, equal along the line.

    Either a constant, ``y_l + b_l``, white down the frame: unlike texture it isn't lit, so each
    line's flicker is smaller or larger relative to its static level than its neighbours'. Or a gain
    that varies in time by one course for all lines, ``y_l·(1 + p_l·course_n)``, with a pattern of
    any shape.
    """

    name = "row_banding"
    of_camera = True
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
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """A constant, and the course that a pattern of the rows' gains follows."""
        course = features.row_course
        return [{}, *([{"course": tuple(course.tolist())}] if course.size else [])]
