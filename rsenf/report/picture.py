"""One picture of a comparison: spectrogram, ENF over the reference, correlation against lag."""

from __future__ import annotations

import logging
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.match.kernel import average, window_kernel
from rsenf.match.ncc import masked_ncc
from rsenf.match.series import Grid, Track, grid_of, phases, to_step_of, track_of
from rsenf.messages import EnfEstimate, MatchResult, ReferenceBlock
from rsenf.report.spectrum import ThinRows
from rsenf.report.verdict import ppm_text, utc_text
from rsenf.whole_file import whole_file

INK, SIGNAL, GRID, MARK = "#222222", "#0b62a4", "#9a9a9a", "#c23b22"
# As fine as the picture can show; what is finer is drawn as its extremes.
HEIGHT_PX, WIDTH_PX = 280, 1000


def draw(
    path: Path,
    rows: ThinRows,
    estimates: Sequence[EnfEstimate],
    reference: Sequence[ReferenceBlock],
    result: MatchResult,
) -> None:
    """Draw the picture into a PNG file, which appears only when it is complete.

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

    Raises
    ------
    RecordingError
        When the file can't be written.
    """
    # Where it keeps its fonts is nothing to tell a person who wants a picture.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 10), layout="constrained")
    FigureCanvasAgg(figure)
    top, middle, bottom = figure.subplots(3, 1)
    figure.suptitle(textwrap.fill(_headline(result), 100), color=INK, fontsize="medium")
    _draw_spectrogram(top, rows, estimates)
    _draw_enf(middle, estimates, reference, result)
    _draw_correlation(bottom, estimates, reference, result)
    for axes in (top, middle):
        axes.set_xlim(0.0, max(rows.seconds, 1.0))
        axes.set_xlabel("time in the recording (s)")
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def _headline(result: MatchResult) -> str:
    if result.decision != "match":
        return f"{result.decision}: {result.reason}"
    return f"match: the recording begins {_place(result)}"


def _place(result: MatchResult) -> str:
    utc = utc_text(result.start_utc_ns)
    error = f" ± {result.lag_std_s:.2f}" if math.isfinite(result.lag_std_s) else ""
    place = f"{result.lag_s:.2f}{error} s into the reference"
    return f"at {utc}, {place}" if utc else place


def _draw_spectrogram(axes: Any, rows: ThinRows, estimates: Sequence[EnfEstimate]) -> None:
    what = "picture by picture" if rows.kept_rows == 1 else "row by row of the picture"
    axes.set_title(f"Flicker of the light, {what}", loc="left")
    axes.set_ylabel("frequency (Hz)")
    if not math.isfinite(rows.frame_rate_hz):
        _say_nothing(axes, "too short to draw")
        return
    t_s, f_hz, level_db = rows.spectrogram()
    # Lines are thinner than the picture's pixels: each pixel shows the strongest of its own.
    shown = _extremes(level_db, HEIGHT_PX)[1]
    half_s = (t_s[1] - t_s[0]) / 2 if t_s.size > 1 else rows.seconds / 2
    axes.imshow(
        shown, origin="lower", aspect="auto", interpolation="nearest", cmap="magma",
        vmin=float(np.percentile(shown, 30)),
        extent=(t_s[0] - half_s, t_s[-1] + half_s, 0.0, f_hz[-1]),
    )  # fmt: skip
    axes.set_facecolor("black")
    lines_hz = [rows.seen_hz(e.line_hz) for e in estimates if e.usable]
    if lines_hz and lines_hz[-1] <= f_hz[-1]:
        axes.set_title("◂ the line followed", loc="right", color=MARK, fontsize="medium")
        axes.annotate(
            f" ◂ {lines_hz[-1]:.1f} Hz", (1.0, lines_hz[-1]),
            xycoords=("axes fraction", "data"), va="center", color=MARK, annotation_clip=False,
        )  # fmt: skip


def _draw_enf(
    axes: Any,
    estimates: Sequence[EnfEstimate],
    reference: Sequence[ReferenceBlock],
    result: MatchResult,
) -> None:
    axes.set_title("Electric network frequency (ENF)", loc="left")
    axes.set_ylabel("ENF (Hz)")
    if not any(e.usable for e in estimates):
        _say_nothing(axes, "no usable signal")
        return
    track, grid = track_of(estimates), grid_of(reference)
    t_s = track.first_s + np.arange(track.enf_hz.size) * track.hop_s
    std_hz = np.sqrt(track.var_hz2)
    if math.isfinite(result.lag_s):
        ref_s = (np.arange(grid.freq_hz.size) + 0.5) * grid.step_s - result.lag_s
        near = (ref_s >= 0.0) & (ref_s <= t_s[-1] + track.first_s)
        read_hz = grid.freq_hz[near] * (1.0 - result.clock_ppm * 1e-6)
        where = "there" if result.decision == "match" else "at the best fit"
        axes.plot(
            ref_s[near], read_hz, color=GRID, lw=2.5,
            label=f"reference {where}, seen by a clock off by {ppm_text(result.clock_ppm)} ppm",
        )  # fmt: skip
    axes.fill_between(
        t_s, track.enf_hz - 2 * std_hz, track.enf_hz + 2 * std_hz, color=SIGNAL, alpha=0.2, lw=0,
        label="± 2 standard errors",
    )  # fmt: skip
    axes.plot(t_s, track.enf_hz, color=SIGNAL, lw=1.2, label="from the recording")
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.margins(y=0.15)
    axes.legend(loc="upper center", frameon=False, ncols=3)


def _draw_correlation(
    axes: Any,
    estimates: Sequence[EnfEstimate],
    reference: Sequence[ReferenceBlock],
    result: MatchResult,
) -> None:
    axes.set_title("How well each time of the reference fits", loc="left")
    axes.set_ylabel("correlation")
    if not math.isfinite(result.lag_s):
        _say_nothing(axes, "nothing to compare")
        return
    track, grid = track_of(estimates), grid_of(reference)
    unit_s, unit = (3600.0, "hours") if grid.duration_s > 7200.0 else (1.0, "seconds")
    axes.set_xlabel(f"start of the recording, {unit} into the reference")
    lag_s, correlation = _correlations(track, grid)
    first_s, last_s = _extremes(lag_s, WIDTH_PX)
    best = _extremes(correlation, WIDTH_PX)[1]
    axes.plot((first_s + last_s) / 2 / unit_s, best, color=GRID, lw=0.8)
    axes.plot(result.lag_s / unit_s, result.correlation, "o", color=MARK, ms=7)
    right = result.lag_s > 0.7 * grid.duration_s
    axes.annotate(
        f"best fit: {result.correlation:.4f}", (result.lag_s / unit_s, result.correlation),
        (-8 if right else 8, 6), textcoords="offset points", ha="right" if right else "left",
        color=MARK,
    )  # fmt: skip
    axes.set_ylim(top=1.2)


def _correlations(track: Track, grid: Grid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Starts (s into the reference) and their correlations, the reference averaged or not."""
    fine = to_step_of(track, grid)
    thin = next(phases(track, fine.step_s))
    ok = np.isfinite(thin.enf_hz)
    found = []
    for freq_hz in (
        fine.freq_hz,
        average(fine.freq_hz, window_kernel(track.window_s, fine.step_s)),
    ):
        there = np.isfinite(freq_hz)
        table = masked_ncc(
            np.nan_to_num(thin.enf_hz), ok, np.nan_to_num(freq_hz), there,
            min_pairs=max(int(ok.sum()) // 2, 3),
        )  # fmt: skip
        found.append(table.correlation)
    lags = table.lags.astype(np.float64)
    return (lags + 0.5) * fine.step_s - thin.first_s, np.fmax(*found)


def _extremes(
    values: NDArray[np.float64], most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and greatest of each of at most so many stretches of rows; NaN where all are."""
    each = max(math.ceil(len(values) / most), 1)
    edges = np.arange(0, len(values), each)
    return np.fmin.reduceat(values, edges, axis=0), np.fmax.reduceat(values, edges, axis=0)


def _say_nothing(axes: Any, text: str) -> None:
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes, color=INK)
    axes.set_xticks([])
    axes.set_yticks([])
