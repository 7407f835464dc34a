"""A template for an effect of one's own.

Copy this file, change it, and use it without touching the package::

    rsenf simulate --effects my_effect.py --effect hum_bars:depth_ratio=0.01 --out clip.npz
    rsenf discover clip.npz --effects my_effect.py --out found

1. Choose where it acts: the classes of :mod:`rsenf.model.effects.base` name the places of the
   capture, in the order that light passes them, and what ``apply`` is given at each.
2. Name it, say where it is known from, what it can be confused with, what decides, and how weak it
   may be and still be named (or, as ``not_hidden``, why a blind test can't hide it).
3. Make its parameters: default, one line, plausible range; the unit is in the name. 'discover'
   estimates those with ``Fitting(neutral, step)``: the value that does nothing (None where there
   is none), and a step within which the response is linear. Without one it never tries the effect.
4. Say in the docstring, in one paragraph, what it does to the data.
5. Write ``apply``. Random numbers come from ``run.rng()`` alone, so that a seed is a clip; a series
   over the whole clip from ``run.kept``; whatever has to be remembered from one block of frames
   to the next goes into ``run.memory``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.model.effects import Run, SensorEffect, Weakest
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter


@dataclass(frozen=True, kw_only=True)
class HumBars(SensorEffect):
    """Faint bars roll slowly over the picture.

    Every line's gain swings at a fixed pattern down the frame, which moves on a little from frame
    to frame: a line at ``roll_hz``, whose phase ramp down the rows has ``bars`` turns.
    """

    name = "hum_bars"
    source = "ground loops of analogue cameras"
    confused_with = ("interharmonic", "moving_stripes")
    told_apart_by = "the number of bars doesn't follow the frequency"
    weakest = Weakest(0.001, "depth_ratio")

    depth_ratio: float = parameter(
        0.005, "amplitude over the level", low=0, high=0.5, fitting=Fitting(0.0, 1e-3)
    )
    bars: float = parameter(1.5, "bars in a frame's height", low=0, high=100)
    roll_hz: float = parameter(0.7, "frames' heights that they roll in a second", low=0, high=30)

    def apply(self, light: LineLight, run: Run) -> None:
        """Multiply each line's light."""
        down = np.arange(run.shutter.lines) / run.shutter.lines
        turns = self.bars * down - self.roll_hz * run.step_s * light.number[:, None]
        light.scale(1 + self.depth_ratio * np.cos(2 * np.pi * turns))
