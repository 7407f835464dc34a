"""The picture of a comparison: spectrogram, ENF over the reference, and score against lag."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.match.correlate import lag_scores
from rsenf.match.series import Grid, Track, grid_of, track_of, without_jumps
from rsenf.match.settings import MatchSettings
from rsenf.messages import EnfEstimate, MatchResult, ReferenceBlock
from rsenf.report.panels import GRID, INK, SIGNAL, fixed_style, new_figure, say_nothing
from rsenf.report.score_curve import ScoreCurve, draw_score, no_curve, score_curve
from rsenf.report.spectrum import ThinRows, draw_spectrogram
from rsenf.report.verdict import headline, ppm_text
from rsenf.whole_file import whole_file


def draw(
    path: Path,
    rows: ThinRows,
    estimates: Sequence[EnfEstimate],
    reference: Sequence[ReferenceBlock],
    result: MatchResult,
) -> None:
    """Draw the picture into a PNG file, which appears only once it is complete.

    Parameters
    ----------
    path : Path
        File to write; an existing one is replaced.
    rows : ThinRows
        Data of the spectrogram.
    estimates : sequence of EnfEstimate
        The recording's ENF.
    reference : sequence of ReferenceBlock
        The grid frequency that it was compared with.
    result : MatchResult
        Result of the comparison.

    Raises
    ------
    RecordingError
        When the file can't be written.
    """
    track = without_jumps(track_of(estimates))[0] if estimates else None
    grid = grid_of(reference) if reference else None
    curve = curve_of(track, grid, MatchSettings(), result)
    with fixed_style(), whole_file(path) as temporary:
        figure = new_figure(10, 10)
        top, middle, bottom = figure.subplots(3, 1)
        figure.suptitle(textwrap.fill(headline(result), 100), color=INK, fontsize="medium")
        draw_spectrogram(top, rows, estimates)
        draw_enf(middle, track, grid, result)
        draw_score(bottom, curve, grid.t0_ns if grid else 0, result)
        figure.savefig(temporary, format="png", dpi=110)


def curve_of(
    track: Track | None, grid: Grid | None, settings: MatchSettings, result: MatchResult
) -> ScoreCurve:
    """Return the scores behind a result; an empty curve if nothing could be compared.

    Parameters
    ----------
    track, grid : Track or None, Grid or None
        ENF of the recording and of the reference.
    settings : MatchSettings
    result : MatchResult
    """
    if track is None or grid is None or not math.isfinite(result.lag_s):
        return no_curve()
    first_s = -track.first_s - track.enf_hz.size * track.hop_s
    pieces = lag_scores(track, grid, settings, result.lag_s)
    return score_curve(pieces, first_s, grid.duration_s, result.lag_s)


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
