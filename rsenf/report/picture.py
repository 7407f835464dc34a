"""One picture of a comparison: spectrogram, ENF over the reference, correlation against lag."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.match.ncc import masked_ncc
from rsenf.match.series import Grid, Track, grid_of, phases, to_step_of, track_of
from rsenf.messages import EnfEstimate, MatchResult, ReferenceBlock
from rsenf.report.spectrum import ThinRows
from rsenf.whole_file import whole_file

INK, SIGNAL, GRID, MARK = "#222222", "#0b62a4", "#9a9a9a", "#c23b22"
TOP_HZ = 240.0


def draw(
    path: Path,
    rows: ThinRows,
    estimates: Sequence[EnfEstimate],
    reference: Sequence[ReferenceBlock],
    result: MatchResult,
) -> None:
    """Draw the picture into a PNG file.

    Parameters
    ----------
    path : Path
        File to write; replaced when it is there.
    rows : ThinRows
        What the spectrogram is made of.
    estimates : sequence of EnfEstimate
        The recording's ENF.
    reference : sequence of ReferenceBlock
        What it was compared with.
    result : MatchResult
        What came of it.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 10), layout="constrained")
    FigureCanvasAgg(figure)
    top, middle, bottom = figure.subplots(3, 1)
    figure.suptitle(_headline(result), color=INK)
    _draw_spectrogram(top, rows, estimates)
    if estimates and any(e.usable for e in estimates):
        track, grid = track_of(estimates), grid_of(reference)
        _draw_enf(middle, track, grid, result)
        _draw_correlation(bottom, track, grid, result)
    else:
        for axes in (middle, bottom):
            axes.text(0.5, 0.5, "no usable signal", ha="center", transform=axes.transAxes)
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def _headline(result: MatchResult) -> str:
    if result.decision != "match":
        return f"{result.decision}: {result.reason}"
    return (
        f"match at lag {result.lag_s:.2f} ± {result.lag_std_s:.2f} s, "
        f"likelihood ratio 10^{result.log10_lr:.1f}"
    )


def _draw_spectrogram(axes: Any, rows: ThinRows, estimates: Sequence[EnfEstimate]) -> None:
    axes.set_title("Light in the rows of the picture", loc="left")
    axes.set_xlabel("time in the recording (s)")
    axes.set_ylabel("frequency (Hz)")
    if not math.isfinite(rows.frame_rate_hz):
        return
    t_s, f_hz, level_db = rows.spectrogram()
    shown = f_hz <= min(TOP_HZ, f_hz[-1])
    low = float(np.percentile(level_db[shown], 30))
    axes.pcolormesh(t_s, f_hz[shown], level_db[shown], shading="nearest", vmin=low, cmap="magma")
    usable = [e for e in estimates if e.usable and e.line_hz <= f_hz[-1]]
    if usable:
        line_hz = usable[-1].line_hz
        axes.annotate(
            f"line followed, {line_hz:.1f} Hz", (t_s[-1], line_hz), (-4, 4),
            textcoords="offset points", ha="right", color="white",
        )  # fmt: skip


def _draw_enf(axes: Any, track: Track, grid: Grid, result: MatchResult) -> None:
    t_s = track.first_s + np.arange(track.enf_hz.size) * track.hop_s
    std_hz = np.sqrt(track.var_hz2)
    axes.set_title("Electric network frequency", loc="left")
    axes.set_xlabel("time in the recording (s)")
    axes.set_ylabel("Hz")
    if math.isfinite(result.lag_s):
        ref_s = (np.arange(grid.freq_hz.size) + 0.5) * grid.step_s - result.lag_s
        near = (ref_s >= t_s[0] - track.first_s) & (ref_s <= t_s[-1] + track.first_s)
        axes.plot(ref_s[near], grid.freq_hz[near], color=GRID, lw=2.5, label="reference there")
    axes.fill_between(
        t_s, track.enf_hz - 2 * std_hz, track.enf_hz + 2 * std_hz, color=SIGNAL, alpha=0.2, lw=0,
        label="± 2 standard errors",
    )  # fmt: skip
    axes.plot(t_s, track.enf_hz, color=SIGNAL, lw=1.2, label="from the video")
    axes.ticklabel_format(useOffset=False)
    axes.legend(loc="best", frameon=False)


def _draw_correlation(axes: Any, track: Track, grid: Grid, result: MatchResult) -> None:
    axes.set_title("How well each time fits", loc="left")
    axes.set_xlabel("start of the recording, seconds into the reference")
    axes.set_ylabel("correlation")
    fine = to_step_of(track, grid)
    thin = next(phases(track, fine.step_s))
    ok_x, ok_y = np.isfinite(thin.enf_hz), np.isfinite(fine.freq_hz)
    table = masked_ncc(
        np.nan_to_num(thin.enf_hz), ok_x, np.nan_to_num(fine.freq_hz), ok_y,
        min_pairs=max(int(ok_x.sum()) // 2, 3),
    )  # fmt: skip
    lag_s = (table.lags + 0.5) * fine.step_s - thin.first_s
    axes.plot(lag_s, table.correlation, color=GRID, lw=0.6)
    if math.isfinite(result.lag_s) and math.isfinite(result.correlation):
        axes.plot(result.lag_s, result.correlation, "o", color=MARK, ms=7)
        axes.annotate(
            f"{result.correlation:.4f} at {result.lag_s:.1f} s", (result.lag_s, result.correlation),
            (8, -12), textcoords="offset points", color=MARK,
        )  # fmt: skip
    axes.set_ylim(-1.05, 1.12)
