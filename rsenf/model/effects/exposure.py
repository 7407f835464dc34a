"""Exposure time."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.model.effects.base import ReadOutEffect, Run
from rsenf.model.parameters import ParameterError, parameter
from rsenf.model.readout import ReadOut
from rsenf.model.shutter import Shutter


@dataclass(frozen=True, kw_only=True)
class Exposure(ReadOutEffect):
    """Each line integrates light over a time, not in an instant.

    Harmonic ``k`` is multiplied by ``sinc(k·f_0·T_e)`` and delayed by half an exposure. An exposure
    of 1/200 s removes the second harmonic of 100 Hz light, 1/100 s removes everything.
    """

    name = "exposure"
    source = "the mean of a tone over an interval"
    confused_with = ("flicker_ratio", "harmonics")
    told_apart_by = (
        "alone it only lowers the signal, which is a parameter of the light; the ratio of two "
        "harmonics of a known lamp tells it"
    )
    not_hidden = "alone it only lowers the signal, which is fitted anyway"

    exposure_s: float = parameter(0.002, "exposure of a line, camera's clock", low=0, high=1)

    def check(self, shutter: Shutter) -> None:
        """Refuse an exposure longer than the frame period."""
        if self.exposure_s > 1 / shutter.frame_rate:
            raise ParameterError(
                ("exposure_s",),
                f"is {self.exposure_s:g}, longer than a frame",
                f"at most {float(1 / shutter.frame_rate):.4g} at {shutter.frame_rate} fps",
            )

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Set the exposure."""
        read_out.exposure_s = self.exposure_s
