"""Plot of the recording's ENF over the reference's."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rsenf.match.series import Grid, Track
from rsenf.messages import MatchResult
from rsenf.report.panels import GRID, SIGNAL, say_nothing
from rsenf.report.verdict import ppm_text


def draw_enf(axes: Any, track: Track | None, grid: Grid | None, result: MatchResult) -> None:
    """Draw the recording's ENF, and the reference's at the best lag by the camera's clock.

    Parameters
    ----------
    axes : matplotlib axes
    track, grid : Track or None, Grid or None
        ENF of the recording and of the reference.
    result : MatchResult
        Its lag and clock error are applied to the reference.
    """
    axes.set_title("Electric network frequency (ENF)")
    if track is None or not track.usable:
        say_nothing(axes, "no usable signal")
        return
    axes.set_ylabel("ENF (Hz)")
    axes.set_xlabel("time in the recording (s)")
    t_s = track.first_s + np.arange(track.enf_hz.size) * track.hop_s
    end_s = t_s[-1] + track.first_s
    if grid is not None and math.isfinite(result.lag_s):
        # A reference may be years long: only the part beside the clip is read.
        first = max(math.ceil(result.lag_s / grid.step_s - 0.5), 0)
        last = max(math.floor((result.lag_s + end_s) / grid.step_s + 0.5), first)
        clock_ppm = result.clock_ppm if math.isfinite(result.clock_ppm) else 0.0
        near_hz = np.asarray(grid.freq_hz[first:last]) * (1.0 - clock_ppm * 1e-6)
        near_s = (first + np.arange(near_hz.size) + 0.5) * grid.step_s - result.lag_s
        where = "found" if result.decision == "match" else "that fits best"
        axes.plot(near_s, near_hz, color=GRID, lw=3.0, label=f"reference, at the time {where}")
        axes.set_title(
            f"as seen by a clock off by {ppm_text(clock_ppm)} ppm", loc="right",
            fontsize="small", fontweight="normal",
        )  # fmt: skip
    std_hz = np.sqrt(track.var_hz2)
    axes.fill_between(
        t_s, track.enf_hz - 2 * std_hz, track.enf_hz + 2 * std_hz, color=SIGNAL, alpha=0.2, lw=0,
        label="± 2 standard errors",
    )  # fmt: skip
    axes.plot(t_s, track.enf_hz, color=SIGNAL, lw=1.2, label="from the recording")
    axes.ticklabel_format(axis="y", useOffset=False)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.2 * (high - low))  # room for the legend
    axes.set_xlim(0.0, max(end_s, 1.0))
    axes.legend(loc="upper center", frameon=False, ncols=3, fontsize="small")
