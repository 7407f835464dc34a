"""Reversed read-out, from the last line to the first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rsenf.model.effects.base import ReadOutEffect, Run
from rsenf.model.effects.hiding import Weakest
from rsenf.model.effects.residue import GROSS, Residue
from rsenf.model.readout import ReadOut


@dataclass(frozen=True, kw_only=True)
class ReverseReadout(ReadOutEffect):
    """The shutter rolls from bottom to top, as in a camera mounted upside down.

    The phase ramp of every harmonic down the frame changes its sign.
    """

    name = "reverse_readout"
    source = "cameras mounted upside down, some phones' front cameras; vflip"
    confused_with = ("grid frequency",)
    told_apart_by = (
        "where the alias is at 0 Hz (25 fps at 50 Hz) direction and the sign of the ENF's "
        "deviation can't be told apart without a reference"
    )
    weakest = Weakest()

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Reverse the order of the lines."""
        read_out.line_s = read_out.line_s[:, ::-1]

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """The effect itself, if hardly anything fits."""
        return [{}] if abs(residue.gap) > GROSS else []
