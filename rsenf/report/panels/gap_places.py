"""The gap of each part of the picture and of the recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

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
    axes: Any,
    axis: str,
    before: Sequence[Share],
    after: Sequence[Share],
    gaps: Sequence[float],
    limit: float,
) -> None:
    """Draw each part's own gap along an axis, before and after, with standard errors.

    Parameters
    ----------
    axes : matplotlib axes
    axis : str
        A key of ``AXES``.
    before, after : sequence of Share
    gaps : sequence of float
        Whole gap before and after.
    limit : float
        Below which a whole gap is none.
    """
    title, label = AXES[axis]
    axes.set_title(title)
    axes.set_yscale("log")
    lowest = limit / FAR
    axes.axhspan(lowest, limit, color=SIGNAL, alpha=0.12, lw=0)
    for shares, whole, colour, width in (
        (before, gaps[0], GRID, 6.0),
        (after, gaps[1], SIGNAL, 3.0),
    ):
        own = [share for share in shares if share.axis == axis]
        for share in own:
            # Parts are alike in size: each one's own gap is its share times how many there are.
            value = max(abs(share.share * whole) * len(own), 1.1 * lowest)
            error = value / max(abs(share.sure), 1e-9)
            pale = 1.0 if abs(share.sure) > SURE else 0.4
            axes.hlines(value, share.low, share.high, color=colour, lw=width, alpha=pale)
            middle, ends = (share.low + share.high) / 2.0, (value - error, value + error)
            axes.vlines(middle, max(ends[0], lowest), ends[1], color=colour, lw=1, alpha=pale)
    places = [end for share in before if share.axis == axis for end in (share.low, share.high)]
    axes.set_xlim(np.min(places), np.max(places))
    axes.set_ylim(bottom=lowest)
    axes.set_xlabel(label)
