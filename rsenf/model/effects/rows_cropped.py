"""Cropping of rows at the top and the bottom."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.model.effects.base import ReadOutEffect, Run
from rsenf.model.parameters import parameter
from rsenf.model.readout import ReadOut


@dataclass(frozen=True, kw_only=True)
class RowsCropped(ReadOutEffect):
    """Lines at the top and bottom are read and discarded; the picture is the rest.

    The read-out time of the picture is shorter by the cropped share, and the light's phase at its
    first line is later by half of it: exactly as in a capture with a longer idle period.
    """

    name = "rows_cropped"
    source = "electronic image stabilisation, digital zoom, 16:9 from a 4:3 sensor"
    confused_with = ("idle_ratio",)
    told_apart_by = "nothing in the data: it is a change of the idle ratio"
    not_hidden = "it is a change of the idle ratio, which is fitted anyway"

    crop_ratio: float = parameter(0.1, "share of the lines thrown away", low=0, high=0.9)

    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Shorten the read-out, and begin it later."""
        skipped_s = self.crop_ratio / 2 * read_out.read_out_s
        read_out.line_s = skipped_s + (1 - self.crop_ratio) * read_out.line_s
        read_out.read_out_s *= 1 - self.crop_ratio
