"""Pictures of a recording's ENF beside a reference."""

from __future__ import annotations

import math

import numpy as np

from rsenf.discrepancy.beside import BesideDiscovery
from rsenf.report.pages import HEIGHT_IN, Picture, picture_of
from rsenf.report.panels import fixed_style
from rsenf.report.panels.enf_beside import draw_enf_beside
from rsenf.report.panels.gap_steps import draw_gap_steps

WIDTH_IN = 5.2
_GAP = (
    "The gap is what the model gets wrong of the ENF, as a share of the reference's variance. Red "
    "is more than chance makes, blue is not; the bar is the standard error, and a hollow diamond "
    "is a gap below zero, drawn by its size. The shaded range is what recordings have that the "
    "model explains. The scale is logarithmic."
)
_ENF = (
    "Above, the ENF as the recording has it and as the model, filming the reference's grid, says "
    "it would be; below, the one less the other. A clock that is off shifts all of it by a "
    "constant share. The shaded range is twice the standard deviation that noise alone would "
    "make; the grey bars at the foot mark the stretches that nothing was fitted to."
)


def draw_beside(found: BesideDiscovery) -> list[Picture]:
    """Draw the gap, and the ENF before and after; where nothing was added, there is but one."""
    fits = [("before", found.first), ("after", found.last)]
    if not found.skew:
        fits = [("measured and simulated", found.last)]
    gaps = [found.gap(fit) for _, fit in fits]
    names = ["at first", "+ clock_skew"][: len(fits)]
    told = ", ".join(f"{n} {g.value:.1e}" for n, g in zip(names, gaps, strict=True))
    left = ", ".join(f"{1e3 * np.nanstd(fit.left_hz):.3g} mHz" for _, fit in fits)
    with fixed_style():
        return [
            picture_of(
                "beside_gap.png", "The gap, step by step",
                lambda f: draw_gap_steps(
                    f.subplots(), names, gaps, found.floor, of="the reference's variance"
                ),
                _GAP, f"Chart of the gap on a logarithmic scale: {told}.",
                width_in=WIDTH_IN, height_in=1.2 + 0.55 * len(names),
            ),
            picture_of(
                "beside_enf.png", "ENF, measured and simulated",
                lambda f: draw_enf_beside(f, found.beside, fits, math.sqrt(found.chance.var_hz2)),
                _ENF, f"ENF over time, and what is left of it, which varies by {left}.",
                width_in=WIDTH_IN, height_in=1.4 * HEIGHT_IN,
            ),
        ]  # fmt: skip
