"""A read-out that becomes slower or faster."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rsenf.model.effects.base import ReadOutEffect, Run
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.parameters import Fitting, parameter
from rsenf.model.readout import ReadOut


@dataclass(frozen=True, kw_only=True)
class ReadoutDrift(ReadOutEffect):
    """The read-out time grows evenly from the clip's start, the frame rate stays.

    The flicker's phase at the first line is as it was, and that at the last moves by
    ``2π·f_0·T_ro`` times the drift so far: the ramp down the frame becomes steeper in time.
    """

    name = "readout_drift"
    source = "line clocks that follow the sensor's temperature, mode changes; to 1 % a minute"
    confused_with = ("image_wobble", "rows_cropped")
    told_apart_by = "it is nought at the first line and grows down the frame"
    weakest = Weakest(0.002, "drift_per_min")

    drift_per_min: float = parameter(
        0.002, "relative change of the read-out time in a minute", low=-0.2, high=0.2,
        fitting=Fitting(0.0, 0.002),
    )  # fmt: skip

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Stretch the lines' times, later frames more."""
        stretch = 1 + self.drift_per_min / 60 * run.step_s * read_out.number
        read_out.line_s = read_out.line_s * stretch[:, None]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """In either direction."""
        return {name: hiding.sign() * value for name, value in super().hidden(hiding).items()}
