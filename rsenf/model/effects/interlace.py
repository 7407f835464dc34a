"""Interlaced fields."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import ReadOutEffect, Run
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.effects.residue import GROSS, Residue
from rsenf.model.parameters import Fitting, parameter
from rsenf.model.readout import ReadOut

COMB = 1e-5  # excess of the gap of rows two apart over that of neighbours: alternating error


@dataclass(frozen=True, kw_only=True)
class Interlace(ReadOutEffect):
    """Even and odd lines come from two fields, half a frame period apart.

    Each field is read like a frame of half the lines, with the same time per line; the second one
    may begin slightly later or earlier than half a period after the first. Neighbouring lines then
    differ in phase by about ``π·f_0/F_r``, with alternating sign: a comb at the finest pattern that
    lines can show.
    """

    name = "interlace"
    source = "PAL, NTSC and 1080i cameras; FFmpeg's interlace filter"
    confused_with = ("row_banding", "readout_drift")
    told_apart_by = "lines taken apart by parity; the comb turns with the flicker"
    masks = ("readout_drift",)  # resembles a small error of the fields' times
    weakest = Weakest()
    never_with = ("reverse_readout",)

    bottom_first: bool = parameter(False, "odd lines come first")
    second_late_s: float = parameter(
        0.0, "how much later than half a frame period the second field is", low=-1e-3, high=1e-3,
        fitting=Fitting(None, 1e-5),
    )  # fmt: skip

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Read the lines of one field, then those of the other."""
        line = np.arange(run.shutter.lines)
        second_field = line % 2 == (0 if self.bottom_first else 1)
        later_s = run.step_s / 2 + self.second_late_s
        read_out.line_s = read_out.line_s[:, line // 2] + second_field * later_s

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """Either field first, if hardly anything fits or rows have an alternating error."""
        seen = residue.gap > GROSS or residue.comb - residue.gap > COMB
        return [{"bottom_first": b} for b in (False, True)] if seen else []

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw which field comes first."""
        return {"bottom_first": bool(hiding.rng.integers(2))}
