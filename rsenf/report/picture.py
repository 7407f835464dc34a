"""The picture of a comparison: spectrogram, ENF over the reference, and score against lag.

The spectrogram is of the concatenated rows, in which the lines of the flicker are visible:
periodograms with a Hann window of 10 s, 2 s apart.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.match.correlate import lag_scores
from rsenf.match.series import Grid, Track, grid_of, track_of, without_jumps
from rsenf.match.settings import MatchSettings
from rsenf.messages import EnfEstimate, MatchResult, ReferenceBlock, RowBlock
from rsenf.report import panels
from rsenf.report.score_curve import ScoreCurve, draw_score, no_curve, score_curve
from rsenf.report.values import ppm_text
from rsenf.report.verdict import headline
from rsenf.timebase import nanoseconds

# Row means kept per frame: enough for lines up to 240 Hz at 30 frames/s, in little memory.
KEPT_ROWS = 16
TOP_HZ = 240.0
WINDOW_S, STEPS_PER_WINDOW = 10.0, 5
# At this number, columns are averaged in pairs: hours of video take no more memory than minutes.
MAX_COLUMNS = 512


class ThinRows:
    """Spectrogram of row means, averaged to a few per frame, in bounded memory.

    The series is the paper's (Section III-B): the rows of all frames concatenated, as if none were
    missing between frames. In each window each row's mean is subtracted, and with it the picture's
    texture.
    """

    def __init__(self) -> None:
        self.frame_rate_hz = float("nan")
        self.seconds = 0.0
        self._rows: NDArray[np.float32] = np.empty((0, 0), np.float32)  # of the current window
        self._first = (0, 0)  # number and time of the first frame
        self._window = 0  # frames in a window, once the frame rate is known
        self._columns: list[NDArray[np.float64]] = []  # power, each the mean of ``_merged`` windows
        self._merged = 1
        self._open: list[NDArray[np.float64]] = []  # windows of the next column

    def add(self, block: RowBlock) -> None:
        """Add a block of rows; blocks of another picture size are left out."""
        thin = _thinned(block)
        if not self._rows.size:
            self._rows = thin[:0]
            self._first = int(block.frame_number[0]), int(block.frame_pts_ns[0])
        if thin.shape[1] != self._rows.shape[1]:
            return
        self._rows = np.concatenate([self._rows, thin])
        frames = int(block.frame_number[-1]) - self._first[0]
        elapsed_ns = int(block.frame_pts_ns[-1]) - self._first[1]
        self.seconds = elapsed_ns / 1e9
        if not self._window and elapsed_ns > 0:
            self.frame_rate_hz = frames / self.seconds
            if elapsed_ns >= nanoseconds(WINDOW_S):
                self._window = len(self._rows)
        while self._window and len(self._rows) >= self._window:
            self._take(_power(self._rows[: self._window], self.frame_rate_hz))
            self._rows = self._rows[self._step :]

    @property
    def _step(self) -> int:
        return max(self._window // STEPS_PER_WINDOW, 1)

    def _take(self, power: NDArray[np.float64]) -> None:
        """Add a window's spectrum to the open column; merge columns in pairs if there are many."""
        self._open.append(power)
        if len(self._open) < self._merged:
            return
        self._columns.append(np.mean(self._open, axis=0))
        self._open = []
        if len(self._columns) == MAX_COLUMNS:
            pairs = zip(self._columns[::2], self._columns[1::2], strict=True)
            self._columns = [(a + b) / 2 for a, b in pairs]
            self._merged *= 2

    @property
    def kept_rows(self) -> int:
        """Row means kept per frame; 1 if the input has one mean per frame."""
        return int(self._rows.shape[1])

    def seen_hz(self, line_hz: float) -> float:
        """Return the alias of a line at the sampling rate of the kept rows."""
        rate_hz = self.frame_rate_hz * self.kept_rows
        return abs(line_hz - rate_hz * round(line_hz / rate_hz))

    def spectrogram(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the spectrogram.

        Returns
        -------
        t_s : ndarray, shape (times,)
            Centres of the windows, uniform, from the first frame.
        f_hz : ndarray, shape (frequencies,)
            Uniform, from 0 to 240 Hz or to the highest frequency of the kept rows.
        level_db : ndarray, shape (frequencies, times)
            Relative to a line with an amplitude of one 8-bit level.

        Raises
        ------
        ValueError
            When there are fewer than two frames.
        """
        if not np.isfinite(self.frame_rate_hz):
            raise ValueError("fewer than two frames")
        window = self._window or len(self._rows)  # a clip shorter than a window is one window
        columns = self._columns or [_power(self._rows, self.frame_rate_hz)]
        first = window / 2 + (self._merged - 1) / 2 * self._step
        centres = first + np.arange(len(columns), dtype=np.float64) * self._merged * self._step
        f_hz = np.arange(len(columns[0]), dtype=np.float64) * self.frame_rate_hz / window
        return centres / self.frame_rate_hz, f_hz, 10.0 * np.log10(np.stack(columns, axis=1) + 1e-9)


def _thinned(block: RowBlock) -> NDArray[np.float32]:
    """Average rows to a few per frame, (frames, kept rows)."""
    rows = block.level.mean(axis=2)
    edges = np.arange(min(KEPT_ROWS, block.rows)) * block.rows // min(KEPT_ROWS, block.rows)
    sizes = np.diff(np.append(edges, block.rows))
    return np.asarray(np.add.reduceat(rows, edges, axis=1) / sizes, np.float32)


def _power(rows: NDArray[np.float32], frame_rate_hz: float) -> NDArray[np.float64]:
    """Return the Hann-windowed periodogram of concatenated rows, as squared amplitudes."""
    series = (rows - rows.mean(axis=0)).reshape(-1).astype(np.float64)
    weights = np.hanning(series.size)
    spectrum = np.fft.rfft(series * weights)
    shown = int(TOP_HZ * len(rows) / frame_rate_hz) + 1
    return np.asarray(np.abs(spectrum[:shown] * 2.0 / weights.sum()) ** 2, np.float64)


HEIGHT_PX = 280  # resolution of the picture; finer frequencies are reduced to their maximum


def draw_spectrogram(axes: Any, rows: ThinRows, estimates: Sequence[EnfEstimate]) -> None:
    """Draw level against frequency and time, and mark the line that was tracked."""
    if not math.isfinite(rows.frame_rate_hz):
        axes.set_title("Flicker of the light")
        panels.say_nothing(axes, "too short to draw")
        return
    what = "picture by picture" if rows.kept_rows == 1 else "row by row of the picture"
    axes.set_title(f"Flicker of the light, {what}")
    axes.set_ylabel("frequency (Hz)")
    axes.set_xlabel("time in the recording (s)")
    t_s, f_hz, level_db = rows.spectrogram()
    # Lines are thinner than a pixel: each pixel shows its strongest frequency.
    shown = panels.extremes(level_db, HEIGHT_PX)[1]
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
        axes.set_title("◂ the line followed", loc="right", color=panels.MARK, fontweight="normal")
        axes.annotate(
            f" ◂ {lines_hz[-1]:.1f} Hz", (1.0, lines_hz[-1]), xycoords=("axes fraction", "data"),
            va="center", color=panels.MARK, annotation_clip=False,
        )  # fmt: skip


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
    with panels.fixed_style():
        figure = panels.new_figure(10, 10)
        top, middle, bottom = figure.subplots(3, 1)
        figure.suptitle(textwrap.fill(headline(result), 100), color=panels.INK, fontsize="medium")
        draw_spectrogram(top, rows, estimates)
        draw_enf(middle, track, grid, result)
        draw_score(bottom, curve, grid.t0_ns if grid else 0, result)
        panels.save(figure, path)


def curve_of(
    track: Track | None, grid: Grid | None, settings: MatchSettings, result: MatchResult
) -> ScoreCurve:
    """Return the scores behind a result; an empty curve if nothing could be compared."""
    if track is None or grid is None or not math.isfinite(result.lag_s):
        return no_curve()
    first_s = -track.first_s - track.enf_hz.size * track.hop_s
    pieces = lag_scores(track, grid, settings, result.lag_s)
    return score_curve(pieces, first_s, grid.duration_s, result.lag_s)


def draw_enf(axes: Any, track: Track | None, grid: Grid | None, result: MatchResult) -> None:
    """Draw the recording's ENF, and the reference's at the best lag by the camera's clock."""
    axes.set_title("Electric network frequency (ENF)")
    if track is None or not track.usable:
        panels.say_nothing(axes, "no usable signal")
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
        axes.plot(
            near_s, near_hz, color=panels.GRID, lw=3.0, label=f"reference, at the time {where}"
        )
        axes.set_title(
            f"as seen by a clock off by {ppm_text(clock_ppm)} ppm", loc="right",
            fontsize="small", fontweight="normal",
        )  # fmt: skip
    std_hz = np.sqrt(track.var_hz2)
    axes.fill_between(
        t_s, track.enf_hz - 2 * std_hz, track.enf_hz + 2 * std_hz, color=panels.SIGNAL,
        alpha=0.2, lw=0, label="± 2 standard errors",
    )  # fmt: skip
    axes.plot(t_s, track.enf_hz, color=panels.SIGNAL, lw=1.2, label="from the recording")
    axes.ticklabel_format(axis="y", useOffset=False)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.2 * (high - low))  # room for the legend
    axes.set_xlim(0.0, max(end_s, 1.0))
    axes.legend(loc="upper center", frameon=False, ncols=3, fontsize="small")
