"""Pictures of a discovery against a reference: the gap, and measured and simulated ENF."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np

from rsenf.discrepancy.clock_offset import AlignedReference, ClockOffsetDiscovery, LagFit
from rsenf.report.pages import HEIGHT_IN, Picture, picture_of
from rsenf.report.panels import GRID, MARK, SIGNAL, fixed_style
from rsenf.report.panels.gap_steps import draw_gap_steps


def draw_enf_beside(
    figure: Any, beside: AlignedReference, fits: Sequence[tuple[str, LagFit]], noise_hz: float
) -> None:
    """Draw measured and simulated ENF, and their difference below, with a column for each fit.

    Parameters
    ----------
    figure : matplotlib figure
    beside : AlignedReference
    fits : sequence of (str, LagFit)
        Fits with their names.
    noise_hz : float
        Standard deviation of a difference due to noise.
    """
    drawn = figure.subplots(2, len(fits), sharex=True, sharey="row", squeeze=False)
    for column, (name, fit) in enumerate(fits):
        above, below = drawn[:, column]
        above.set_title(name)
        above.plot(beside.t_s, fit.said_hz, color=GRID, lw=3.0, label="simulated")
        above.plot(beside.t_s, beside.enf_hz, color=SIGNAL, lw=1.2, label="measured")
        above.ticklabel_format(axis="y", useOffset=False)
        below.axhspan(-2e3 * noise_hz, 2e3 * noise_hz, color=SIGNAL, alpha=0.12, lw=0)
        below.axhline(0.0, color=GRID, lw=0.8)
        below.plot(beside.t_s, 1e3 * fit.residual_hz, color=MARK, lw=1.0)
        for begin_s, end_s in _held_out(beside):
            below.axvspan(begin_s, end_s, ymax=0.04, color=GRID, lw=0)
        below.set_xlabel("time in the recording (s)")
    drawn[0, 0].set_ylabel("ENF (Hz)")
    drawn[1, 0].set_ylabel("difference (mHz)")
    low_hz, high_hz = drawn[0, 0].get_ylim()
    drawn[0, 0].set_ylim(low_hz, high_hz + 0.15 * (high_hz - low_hz))  # room for the legend
    drawn[0, 0].legend(
        loc="upper center", frameon=False, ncols=2, fontsize="small", handlelength=1.2,
        columnspacing=1.0,
    )  # fmt: skip


def _held_out(beside: AlignedReference) -> list[tuple[float, float]]:
    """Return start and end (s) of each held-out block."""
    numbers = np.where(beside.held_out, beside.block, np.nan)
    blocks = groupby(zip(numbers.tolist(), beside.t_s.tolist(), strict=True), key=lambda at: at[0])
    spans = [(number, [t_s for _, t_s in values]) for number, values in blocks]
    return [(t_s[0], t_s[-1]) for number, t_s in spans if number == number]


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


def draw_beside(found: ClockOffsetDiscovery) -> list[Picture]:
    """Draw the gap, and the ENF before and after an addition, or once if nothing was added."""
    fits = [("before", found.first), ("after", found.last)]
    if not found.skew:
        fits = [("measured and simulated", found.last)]
    gaps = [found.gap(fit) for _, fit in fits]
    names = ["at first", "+ clock_skew"][: len(fits)]
    gap_text = ", ".join(f"{n} {g.value:.1e}" for n, g in zip(names, gaps, strict=True))
    residual_text = ", ".join(f"{1e3 * np.nanstd(fit.residual_hz):.3g} mHz" for _, fit in fits)
    with fixed_style():
        return [
            picture_of(
                "beside_gap.png", "The gap, step by step",
                lambda f: draw_gap_steps(
                    f.subplots(), names, gaps, found.floor, of="the reference's variance"
                ),
                _GAP, f"Chart of the gap on a logarithmic scale: {gap_text}.",
                width_in=WIDTH_IN, height_in=1.2 + 0.55 * len(names),
            ),
            picture_of(
                "beside_enf.png", "ENF, measured and simulated",
                lambda f: draw_enf_beside(f, found.beside, fits, math.sqrt(found.chance.var_hz2)),
                _ENF, f"ENF over time, and what is left of it, which varies by {residual_text}.",
                width_in=WIDTH_IN, height_in=1.4 * HEIGHT_IN,
            ),
        ]  # fmt: skip
