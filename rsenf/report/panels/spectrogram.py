"""Spectrogram plot: the flicker's lines over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rsenf.messages import EnfEstimate
from rsenf.report.panels import MARK, extremes, say_nothing
from rsenf.report.spectrum import ThinRows

HEIGHT_PX = 280  # resolution of the picture; finer frequencies are reduced to their maximum


def draw_spectrogram(axes: Any, rows: ThinRows, estimates: Sequence[EnfEstimate]) -> None:
    """Draw level against frequency and time, and mark the line that was tracked.

    Parameters
    ----------
    axes : matplotlib axes
    rows : ThinRows
    estimates : sequence of EnfEstimate
        Tell the frequency of the line.
    """
    if not math.isfinite(rows.frame_rate_hz):
        axes.set_title("Flicker of the light")
        say_nothing(axes, "too short to draw")
        return
    what = "picture by picture" if rows.kept_rows == 1 else "row by row of the picture"
    axes.set_title(f"Flicker of the light, {what}")
    axes.set_ylabel("frequency (Hz)")
    axes.set_xlabel("time in the recording (s)")
    t_s, f_hz, level_db = rows.spectrogram()
    # Lines are thinner than a pixel: each pixel shows its strongest frequency.
    shown = extremes(level_db, HEIGHT_PX)[1]
    half_s = (t_s[1] - t_s[0]) / 2 if t_s.size > 1 else rows.seconds / 2
    axes.imshow(
        shown, origin="lower", aspect="auto", interpolation="nearest", cmap="magma",
        vmin=float(np.percentile(shown, 30)),
        extent=(t_s[0] - half_s, t_s[-1] + half_s, 0.0, f_hz[-1]),
    )  # fmt: skip
    axes.set_facecolor("black")
    axes.set_xlim(0.0, max(rows.seconds, 1.0))
    lines_hz = [rows.seen_hz(e.line_hz) for e in estimates if e.usable]
    if lines_hz and lines_hz[-1] <= f_hz[-1]:
        axes.set_title("◂ the line followed", loc="right", color=MARK, fontweight="normal")
        axes.annotate(
            f" ◂ {lines_hz[-1]:.1f} Hz", (1.0, lines_hz[-1]),
            xycoords=("axes fraction", "data"), va="center", color=MARK, annotation_clip=False,
        )  # fmt: skip
