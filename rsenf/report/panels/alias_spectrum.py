"""What is left by frequency, as the frames show it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.tone import flicker_hz
from rsenf.discrepancy.where import alias_spectrum
from rsenf.report.panels import GRID, INK, SIGNAL, extremes

WIDTH_PX = 500  # as fine as the picture can show; what is finer is drawn as its extremes
MULTIPLES = 3  # of the flicker that are marked


def draw_alias_spectrum(axes: Any, fits: Sequence[tuple[str, Fit]]) -> None:
    """Draw the spectrum of what fits leave: one before, if there is such, and one after."""
    axes.set_title("What is left, by frequency")
    axes.set_yscale("log")
    axes.minorticks_off()
    floors, tops = [], []
    looks = ((SIGNAL, 1.0, 3.0), (GRID, 2.2, 2.0))
    for (name, fit), (colour, width, above) in zip(reversed(fits), looks, strict=False):
        freq_hz, power = alias_spectrum(fit)
        floor = float(np.median(np.abs(power))) or 1e-30
        # Of noise alone, which is as often below zero, only the size of it is shown.
        shown = extremes(np.maximum(power, floor), WIDTH_PX)[1]
        at_hz = extremes(freq_hz, WIDTH_PX)[0]
        axes.plot(at_hz, shown, color=colour, lw=width, label=name, zorder=above)
        floors.append(floor)
        tops.append(float(shown.max()))
    axes.set_ylim(min(floors) / 2.0, max(tops) * 30.0)
    for n, (alias_hz, _) in enumerate(flicker_hz(fits[0][1], range(1, MULTIPLES + 1)), 1):
        axes.axvline(alias_hz, 0.78, 1.0, color=INK, lw=1)
        name = "flicker" if n == 1 else f"{n}f"
        # Their aliases may be neighbours: to either side, one below the other.
        side, ha = (-3, "right") if n % 2 == 0 and alias_hz > 1.0 else (3, "left")
        axes.annotate(
            name, (alias_hz, 1.05 - 0.07 * n), (side, 0), xycoords=("data", "axes fraction"),
            va="top", ha=ha, textcoords="offset points", color=INK, fontsize="small",
        )  # fmt: skip
    axes.set_xlim(0.0, float(fits[0][1].data.frame_rate) / 2.0)
    axes.set_xlabel("frequency, as an alias between 0 and half the frame rate (Hz)")
    axes.set_ylabel("share of the flicker's power")
    if len(fits) > 1:
        axes.legend(
            frameon=False, fontsize="small", loc="upper right", ncols=2, reverse=True,
            bbox_to_anchor=(1.0, 1.14),
        )  # fmt: skip
