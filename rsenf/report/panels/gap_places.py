"""The gap of each part of the picture and of the recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rsenf.discrepancy.where import Share
from rsenf.report.panels import GRID, SIGNAL
from rsenf.report.panels.gap_steps import FAR

AXES = {
    "row": ("by row", "row, from the top"),
    "time_s": ("by time", "time in the recording (s)"),
    "level": ("by level", "level of the wall"),
    "strip": ("by strip", "strip, from the left"),
}
SURE = 3.0  # standard errors from which on a part is drawn full


def axes_of(shares: Sequence[Share]) -> list[str]:
    """Name the axes along which there is more than one part."""
    names = [share.axis for share in shares]
    return [axis for axis in AXES if names.count(axis) > 1]


def draw_gap_places(
    axes: Any, axis: str, sides: Sequence[tuple[Sequence[Share], float]], limit: float
) -> None:
    """Draw each part's own gap along an axis with its standard error, before and after.

    Parameters
    ----------
    axes : matplotlib axes
    axis : str
        A key of ``AXES``.
    sides : sequence of (sequence of Share, float)
        Before, if there is such, and after; each with the whole gap.
    limit : float
        Below which a whole gap is none.
    """
    title, label = AXES[axis]
    axes.set_title(title)
    axes.set_yscale("log")
    axes.minorticks_off()
    lowest = limit / FAR
    axes.axhspan(lowest, limit, color=SIGNAL, alpha=0.12, lw=0)
    for (shares, whole), colour, width in zip(
        reversed(sides), (SIGNAL, GRID), (3.0, 7.0), strict=False
    ):
        own = [share for share in shares if share.axis == axis]
        for share in own:
            # Parts are alike in size: each one's own gap is its share times how many there are.
            value = max(abs(share.share * whole) * len(own), 1.1 * lowest)
            error = value / max(abs(share.sure), 1e-9)
            look = {"color": colour, "alpha": 1.0 if abs(share.sure) > SURE else 0.4}
            look |= {"zorder": 2.0 if colour == GRID else 3.0}
            axes.hlines(value, share.low, share.high, lw=width, **look)
            middle = (share.low + share.high) / 2.0
            axes.vlines(middle, max(value - error, lowest), value + error, lw=1, **look)
        axes.set_xlim(own[0].low, own[-1].high)
    axes.set_ylim(bottom=lowest)
    axes.set_xlabel(label)
    if axis == "strip":
        axes.set_xticks([share.low + 0.5 for share in own], [f"{s.low + 1:.0f}" for s in own])
