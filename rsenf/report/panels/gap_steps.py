"""Plot of the gap after each step of the forward selection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rsenf.discrepancy.gap import Gap
from rsenf.discrepancy.noise_floor import NoiseFloor
from rsenf.report.panels import INK, MARK, SIGNAL

FAR = 30.0  # the scale begins at the limit divided by this


def draw_gap_steps(
    axes: Any,
    names: Sequence[str],
    gaps: Sequence[Gap],
    floor: NoiseFloor,
    of: str = "the flicker's power",
) -> None:
    """Draw the gap after each step, the first on top, with the range of the noise floor.

    Parameters
    ----------
    axes : matplotlib axes
    names : sequence of str
        Names of the steps; the first is the initial model.
    gaps : sequence of Gap
    floor : NoiseFloor
    of : str, optional
        What the gap is normalised by.
    """
    axes.set_title("The gap on held-out data, step by step")
    axes.set_xscale("log")
    axes.minorticks_off()
    lowest = floor.limit / FAR
    axes.axvspan(lowest, floor.limit, color=SIGNAL, alpha=0.12, lw=0)
    axes.axvline(floor.limit, color=SIGNAL, lw=1)
    if floor.median > lowest:
        axes.axvline(floor.median, color=SIGNAL, lw=1, ls=":")
    axes.annotate(
        "chance alone", (lowest, 1.0), (4, -3), xycoords=("data", "axes fraction"), va="top",
        textcoords="offset points", color=SIGNAL, fontsize="small",
    )  # fmt: skip
    for n, gap in enumerate(gaps):
        size, away = abs(gap.value), gap.stderr if math.isfinite(gap.stderr) else 0.0
        shown, colour = max(size, 1.15 * lowest), MARK if size > floor.limit else SIGNAL
        ends = [max(size - away, lowest), max(size + away, shown)]
        axes.plot(ends, [n, n], color=colour, lw=2, solid_capstyle="butt")
        axes.plot(
            [shown], [n], "o" if gap.value > 0 else "D", color=colour, ms=7,
            mfc=colour if gap.value > 0 else "white",
        )  # fmt: skip
        axes.annotate(
            f"{gap.value:.1e}", (shown, n), (0, 8), textcoords="offset points", ha="center",
            color=INK, fontsize="small",
        )  # fmt: skip
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.7)
    axes.set_xlim(lowest, 4.0 * max(floor.limit, *(abs(g.value) for g in gaps)))
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(f"gap, as a share of {of}")
