"""A moving object: a textured box that sweeps from side to side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.model.effects.base import Run, SceneEffect
from rsenf.model.parameters import parameter
from rsenf.model.scene import Float32Array, levels, texture
from rsenf.model.view import Patch


@dataclass(frozen=True, kw_only=True)
class MovingObject(SceneEffect):
    """A box in the lamp's light moves in front of the wall, there and back.

    The level of the rows that it covers changes with its position, which is a periodic series in
    those rows alone, with steps of whole pixels; its flicker is that of the light.
    """

    name = "moving_object"
    source = "people and cars; the paper's moving videos"
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
