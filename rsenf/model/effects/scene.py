"""Effects of what is seen: a pattern that moves through the picture, an object before the wall."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import LightEffect, Run, SceneEffect
from rsenf.model.effects.search import NOTHING_FITS, Hiding, ResidualFeatures, Weakest
from rsenf.model.line_light import LineLight
from rsenf.model.noise import Float32Array
from rsenf.model.parameters import Fitting, parameter
from rsenf.model.scene import Patch, levels, texture


@dataclass(frozen=True, kw_only=True)
class MovingStripes(LightEffect):
    """Even stripes along the lines pass by at a steady speed, and the light with them.

    All light, flicker included, is multiplied by a cosine of place and time,
    ``1 + d·cos(2π(c·y − r·t) + φ)`` at the height ``y`` from 0 to 1: a line at the frequency ``r``
    with aliases at multiples of the frame rate, whose phase ramp down the rows is ``c`` turns, less
    the turns of ``r`` in a read-out time.
    """

    name = "moving_stripes"
    source = "blinds, railings, escalators, scrolling text (Adelson and Bergen, JOSA A 2, 1985)"
    confused_with = ("interharmonic", "pwm_tone", "flicker_ratio")
    told_apart_by = (
        "its frequency never moves as a grid's does, and its ramp need not fit any read-out time"
    )
    any_course = True
    weakest = Weakest(2e-4, "depth_ratio")

    depth_ratio: float = parameter(
        0.1, "amplitude over the mean level", low=0, high=1,
        fitting=Fitting(0.0, 0.002, turn="phase_rad"),
    )  # fmt: skip
    stripes: float = parameter(
        5.0, "stripes in the picture's height", low=0, high=1000, fitting=Fitting(None, 1e-3)
    )
    rate_hz: float = parameter(
        1.0, "stripes that pass a place in a second; negative is upwards", low=-1000, high=1000,
        fitting=Fitting(None, 1e-4),
    )  # fmt: skip
    phase_rad: float = parameter(0.0, "at the top when the clip begins", low=-7, high=7)

    def apply(self, light: LineLight, run: Run) -> None:
        """Modulate the lines, averaged over the exposure of each and over averaged rows."""
        over, lines = light.aperture, light.start_s.shape[1]
        from_row = self.stripes / (lines * over.rows) - self.rate_hz * over.row_s  # turns
        row = np.arange(lines) * over.rows + (over.rows - 1) / 2
        t_s = light.start_s + over.middle_s
        place = row / (lines * over.rows)
        angle = 2 * math.pi * (self.stripes * place - self.rate_hz * t_s) + self.phase_rad
        gain = np.sinc(self.rate_hz * over.exposure_s)
        gain *= np.sinc(over.rows * from_row) / np.sinc(from_row)
        light.scale(1 + self.depth_ratio * gain * np.cos(angle))

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """The pattern that explains the strongest line, if no light does and the flicker fits."""
        if features.pattern is None or features.gap > NOTHING_FITS:
            return []
        stripes, rate_hz = features.pattern
        return [{"stripes": stripes, "rate_hz": rate_hz}]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw stripes that can't be taken for light."""
        stripes, rate_hz = hiding.stripes(3.0, 20.0), hiding.sign() * hiding.tone_hz(1.5, 10.0)
        values = {"stripes": stripes, "rate_hz": rate_hz, **super().hidden(hiding)}
        return values | {"phase_rad": hiding.phase_rad()}


@dataclass(frozen=True, kw_only=True)
class MovingObject(SceneEffect):
    """A box in the lamp's light moves in front of the wall, there and back.

    Its left edge is at ``(columns − width)·(1 − |2·t/period_s − 1|)`` at the time ``t`` of a
    period. The level of the rows that it covers changes with its position, which is a periodic
    series in those rows alone, with steps of whole pixels; its flicker is that of the light.
    """

    name = "moving_object"
    source = "people and cars; the moving videos of the paper, Section III-D"
    confused_with = ("image_wobble", "auto_exposure")
    told_apart_by = "it is in some rows and strips only; pixels that it never touched are steady"
    not_hidden = "it is no light: the mask of steady pixels takes it out of the rows"

    width_ratio: float = parameter(0.2, "width over the frame's width", low=0.01, high=0.9)
    height_ratio: float = parameter(0.3, "height over the frame's height", low=0.01, high=1)
    top_ratio: float = parameter(0.35, "upper edge over the frame's height", low=0, high=0.99)
    period_s: float = parameter(6.0, "time to the other side and back", low=0.1, high=3600)
    level_ratio: float = parameter(0.6, "mean level over the wall's", low=0, high=2)
    texture_ratio: float = parameter(0.25, "standard deviation of its texture", low=0, high=0.5)

    def apply(self, wall: Float32Array, run: Run) -> Patch:
        """Make the box, cut off at the bottom of the picture."""
        rows, columns = wall.shape
        top = min(round(self.top_ratio * rows), rows - 1)
        height = min(max(round(self.height_ratio * rows), 1), rows - top)
        width = max(round(self.width_ratio * columns), 1)
        relative = 1 + self.texture_ratio * texture(height, width, run.seed, "box")
        level = levels(np.asarray(relative), run.mean_level * self.level_ratio)

        def place(t_s: float) -> tuple[int, int]:
            there_and_back = 2 * ((t_s / self.period_s) % 1.0)
            return top, round((columns - width) * min(there_and_back, 2 - there_and_back))

        return Patch(level, place)
