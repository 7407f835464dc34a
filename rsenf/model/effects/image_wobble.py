"""Displacement of the picture on the sensor, as by image stabilisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.model.effects.base import ReadOutEffect, Run
from rsenf.model.grid import FloatArray
from rsenf.model.parameters import Fitting, parameter
from rsenf.model.readout import ReadOut
from rsenf.model.wander import wander


@dataclass(frozen=True, kw_only=True)
class ImageWobble(ReadOutEffect):
    """The window that is cropped from the sensor moves up and down.

    A line of the picture then comes from a line of the sensor that was read earlier or later, so
    the flicker's phase shifts by ``2π·f_0`` times the displacement in line times. Movement that the
    stabilisation doesn't compensate moves the texture, too.
    """

    name = "image_wobble"
    source = "electronic image stabilisation; 0.1 to 20 rows"
    confused_with = ("capture_jitter", "timestamp_jitter")
    told_apart_by = "the texture moves along; with perfect stabilisation nothing tells"
    not_hidden = "in the means of rows it is capture jitter, but for the texture"

    wobble_rows: float = parameter(1.0, "rms of the shift", low=0, high=30)
    time_constant_s: float = parameter(0.02, "of the movement; 0 is white", low=0, high=60)
    rows_down: tuple[float, ...] = parameter(
        (), "exactly these shifts instead, one a frame", low=-100, high=100,
        fitting=Fitting(
            0.0, 0.05, each="frame", wanders=True, rms="wobble_rows", memory="time_constant_s"
        ),
    )  # fmt: skip
    residual_ratio: float = parameter(
        1.0, "share of the shift that the picture shows", low=0, high=1
    )

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Shift the time of each line, and displace the scene."""
        rows = run.kept(lambda rng: self._shifts(rng, run))[read_out.number]
        read_out.line_s = read_out.line_s + rows[:, None] * (
            read_out.read_out_s / run.shutter.lines
        )
        read_out.shift_px[:, 0] -= self.residual_ratio * rows

    def _shifts(self, rng: np.random.Generator, run: Run) -> FloatArray:
        if self.rows_down:
            return run.given(self.rows_down)
        return self.wobble_rows * wander(rng, run.frames, run.step_s, self.time_constant_s)
