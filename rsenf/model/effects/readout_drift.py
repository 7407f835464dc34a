"""Drift of the read-out time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rsenf.model.effects.base import ReadOutEffect, Run
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.effects.residue import Residue
from rsenf.model.parameters import Fitting, parameter
from rsenf.model.readout import ReadOut

EVERY_S = 2.0  # distance of a course's nodes


@dataclass(frozen=True, kw_only=True)
class ReadoutDrift(ReadOutEffect):
    """The read-out time changes during the clip, the frame rate doesn't.

    It drifts linearly, or takes any slow course. The flicker's ramp down the frame becomes steeper
    or flatter: the phase from the first line to the last changes by ``2π·f_0·T_ro`` times the
    relative change.
    """

    name = "readout_drift"
    source = "line clocks that follow the sensor's temperature, mode changes; to 1 % a minute"
    confused_with = ("image_wobble", "rows_cropped")
    told_apart_by = "it is nought at the middle line and grows towards both ends of the frame"
    weakest = Weakest(0.002, "drift_per_min")

    drift_per_min: float = parameter(
        0.002, "relative change of the read-out time in a minute", low=-0.2, high=0.2,
        fitting=Fitting(0.0, 0.002),
    )  # fmt: skip
    drift_ratio: float = parameter(
        0.0, "rms of the relative changes, where they aren't even", low=0, high=0.2
    )
    stretch_ratios: tuple[float, ...] = parameter(
        (), "exactly these relative changes instead, one a frame", low=-0.2, high=0.2,
        fitting=Fitting(0.0, 0.002, each="frame", free=True, every_s=EVERY_S, rms="drift_ratio"),
    )  # fmt: skip
    course: str = parameter("even", "over time: even, or any", choices=("even", "any"))

    @property
    def not_fitted(self) -> tuple[str, ...]:
        """Parameter that the kind of course doesn't use."""
        return ("stretch_ratios",) if self.course == "even" else ("drift_per_min",)

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Stretch the lines' times, about the first line (drift) or the middle one (course)."""
        if self.stretch_ratios:
            change = run.given(self.stretch_ratios)[read_out.number][:, None]
            middle_s = read_out.line_s.mean(axis=1, keepdims=True)
            read_out.line_s = read_out.line_s + change * (read_out.line_s - middle_s)
            return
        stretch = 1 + self.drift_per_min / 60 * run.step_s * read_out.number
        read_out.line_s = read_out.line_s * stretch[:, None]

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """A linear drift, and any course."""
        return [{}, {"course": "any", "drift_per_min": 0.0}]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the sign, too."""
        return {name: hiding.sign() * value for name, value in super().hidden(hiding).items()}
