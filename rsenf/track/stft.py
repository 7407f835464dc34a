"""The paper's estimator: a sliding STFT at one line, refined by quadratic interpolation.

Section V of the paper: 20 s windows, one value a second, the spectrum's peak near the line refined
by quadratic interpolation. The line is chosen once, as the strongest of the paper's candidates
(Eq. 20) in the first window in which one stands out, and kept for the epoch.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.flicker.lines import Line, candidate_lines, project, templates
from rsenf.flicker.slow_time import SlowTime
from rsenf.flicker.tone import ToneFinder
from rsenf.messages import EnfEstimate, Header, RowBlock
from rsenf.timebase import nanoseconds
from rsenf.track.settings import TrackSettings
from rsenf.track.window import LineFit, fit_lines, slow_time_amplitude

# Row blocks held back until the frame rate is known well enough for the phase ramps.
RATE_NEEDS_S = 1.0
# A 20 s window reports a weighted mean of the grid's frequency; a value for its middle second
# differs from it by this much, measured on the first half of a day of the continental grid.
SMEAR_STD_HZ = 1.5e-3
# Weaker than this (levels) is rounding, not light.
MIN_AMPLITUDE_LEVEL = 1e-4
MIN_FILL_RATIO = 0.8
# Nearer to 0 Hz than this (resolution cells) the tone, its mirror image and the constant can't be
# told apart: errors came to 7 mHz at one cell, 0.3 mHz at one and a half.
ZERO_CELLS = 1.5
# Where 0 Hz lies in the search band, drifts of brightness make tones of their own: flicker must
# stand out so many times more there, and be stronger than its mirror image by this much.
MIN_ONE_SIDED = 10.0
DRIFT_MARGIN = 10.0


class StftTracker:
    """Sliding STFT. Implements :class:`rsenf.stage.Stage` from row blocks to ENF estimates.

    Parameters
    ----------
    settings : TrackSettings, optional
    """

    def __init__(self, settings: TrackSettings | None = None) -> None:
        self.settings = settings or TrackSettings()
        self._finder = ToneFinder(
            self.settings.window_s, 2.0 * self.settings.search_hz * self.settings.harmonic
        )
        self._waiting: list[RowBlock] = []
        self._lines: tuple[Line, ...] = ()
        self._ramps: NDArray[np.complex128] = np.empty((0, 0), np.complex128)
        self._buffer: SlowTime | None = None
        self._chosen: Line | None = None
        self._header: Header | None = None
        self._hops = 0
        self._rows = 0

    def update(self, message: RowBlock) -> list[Any]:
        """Take a block of rows; return the estimates whose windows it completes."""
        if message.frames == 0:
            return []
        self._header = message.header
        if self._buffer is None:
            self._waiting.append(message)
            spans = self._waiting[0].frame_pts_ns[0], message.frame_pts_ns[-1]
            if spans[1] - spans[0] < nanoseconds(RATE_NEEDS_S):
                return []
            self._begin()
        else:
            self._take(self._buffer, message)
        return self._complete(final=False)

    def flush(self) -> list[Any]:
        """Return the estimate of the last window, if the stream just fills it."""
        return self._complete(final=True)

    def _begin(self) -> None:
        first, last = self._waiting[0], self._waiting[-1]
        frames = int(last.frame_number[-1] - first.frame_number[0])
        rate_hz = frames * 1e9 / int(last.frame_pts_ns[-1] - first.frame_pts_ns[0])
        s, self._rows = self.settings, first.rows
        nominals = (s.nominal_hz,) if s.nominal_hz else (50.0, 60.0)
        lines = [
            line
            for nominal in nominals
            for line in candidate_lines(nominal, s.harmonic, rate_hz, first.rows)
            if s.line_m is None or line.m == s.line_m
        ]
        if not lines:
            raise UsageError(
                f"no line {s.line_m} at {rate_hz:.2f} frames/s and harmonic {s.harmonic}",
                "leave it out to follow the strongest",
            )
        self._lines = tuple(lines)
        self._ramps = templates(self._lines, rate_hz, first.rows, self._finder.search_hz)
        self._buffer = SlowTime(len(self._lines), int(first.frame_pts_ns[0]))
        for block in self._waiting:
            self._take(self._buffer, block)
        self._waiting = []

    def _take(self, buffer: SlowTime, block: RowBlock) -> None:
        if block.rows == self._rows:
            buffer.append(block, project(block, self._ramps))

    def _complete(self, *, final: bool) -> list[Any]:
        """Estimates of all windows that are full. The last one may lack half a frame."""
        buffer = self._buffer
        out: list[Any] = []
        if buffer is None:
            return out
        s = self.settings
        while True:
            start_s = self._hops * s.hop_s
            end_s = start_s + s.window_s
            rate_hz = buffer.frame_rate_hz(buffer.between(start_s, end_s))
            reached_s = buffer.last_t_s + (1.5 / rate_hz if final and rate_hz > 0 else 0.0)
            if reached_s < end_s:
                return out
            out.append(self._estimate(buffer, start_s, end_s, rate_hz))
            self._hops += 1
            buffer.forget_before(start_s + s.hop_s)

    def _estimate(
        self, buffer: SlowTime, start_s: float, end_s: float, rate_hz: float
    ) -> EnfEstimate:
        part = buffer.between(start_s, end_s)
        blank = self._blank(buffer, start_s, end_s, rate_hz)
        usable_ratio = buffer.usable_ratio(part)
        # Frames that are there, of those that the rate lets one expect.
        fill = (part.stop - part.start) / (rate_hz * (end_s - start_s)) if rate_hz > 0 else 0.0
        if fill < MIN_FILL_RATIO:
            return dataclasses.replace(blank, reason=f"only {fill:.0%} of the frames are there")
        if usable_ratio < MIN_FILL_RATIO:
            return dataclasses.replace(
                blank, reason=f"rows usable in only {usable_ratio:.0%} of the frames"
            )
        lines = (self._chosen,) if self._chosen else self._lines
        columns = {line: self._lines.index(line) for line in lines}
        found = fit_lines(self._finder, buffer, columns, start_s, end_s, rate_hz)
        best = max(found, key=lambda fit: self._rank(fit, rate_hz))
        reason = self._why_unusable(best, rate_hz)
        if reason:
            return dataclasses.replace(blank, snr_db=_decibels(best.tone.snr), reason=reason)
        self._chosen = best.line
        return self._fill(blank, best, buffer, (start_s + end_s) / 2.0)

    def _rank(self, fit: LineFit, rate_hz: float) -> tuple[bool, bool, float]:
        """Usable lines first, then those clear of 0 Hz, then the strongest.

        Near 0 Hz the line that tells flicker from drift best comes before a stronger one.
        """
        usable = not self._why_unusable(fit, rate_hz)
        near_zero = self._near_zero(fit.line, rate_hz)
        return usable, not near_zero, fit.one_sided if near_zero else fit.tone.snr

    def _near_zero(self, line: Line, rate_hz: float) -> bool:
        """Whether 0 Hz lies in the band searched: drifts of brightness look like a tone there."""
        return abs(line.alias_hz(rate_hz)) <= self._finder.search_hz

    def _why_unusable(self, window: LineFit, rate_hz: float) -> str:
        tone, near_zero = window.tone, self._near_zero(window.line, rate_hz)
        min_snr = self.settings.min_snr * (DRIFT_MARGIN if near_zero else 1.0)
        if tone.amplitude < MIN_AMPLITUDE_LEVEL or tone.snr < min_snr:
            return "no mains flicker stands out"
        if tone.at_edge:
            return "strongest at the edge of the search band"
        if self._rows == 1 and near_zero and not self.settings.nominal_hz:
            return "alias near 0 Hz, where brightness drifts: give the nominal frequency"
        if (
            abs(window.line.alias_hz(rate_hz) + tone.offset_hz)
            < ZERO_CELLS / self.settings.window_s
        ):
            return "alias too near 0 Hz, where the picture's texture hides it"
        if self._rows > 1 and near_zero and window.one_sided < MIN_ONE_SIDED:
            return "a slow change of brightness near 0 Hz, not to be told from flicker there"
        limit_hz = self.settings.max_std_hz * 2.0 * self.settings.harmonic
        if tone.offset_var_hz2 > limit_hz**2:
            return "too uncertain"
        return ""

    def _blank(self, buffer: SlowTime, start_s: float, end_s: float, rate_hz: float) -> EnfEstimate:
        """Return what is known of a window before anything is found in it."""
        assert self._header is not None
        newest = self._header
        start_ns, end_ns = (buffer.origin_ns + nanoseconds(t) for t in (start_s, end_s))
        camera_ns = newest.camera_time_ns + start_ns - newest.pts_ns
        frame_first, frame_last = buffer.frame_numbers(buffer.between(start_s, end_s))
        header = dataclasses.replace(
            newest,
            seq=self._hops,
            pts_ns=start_ns,
            camera_time_ns=camera_ns if newest.camera_time_ns else 0,
            frame_first=frame_first,
            frame_last=frame_last,
        )
        return EnfEstimate(
            header=header,
            method="stft",
            harmonic=self.settings.harmonic,
            origin_pts_ns=buffer.origin_ns,
            start_pts_ns=start_ns,
            end_pts_ns=end_ns,
            frame_rate_hz=rate_hz,
        )

    def _fill(
        self, blank: EnfEstimate, best: LineFit, buffer: SlowTime, centre_s: float
    ) -> EnfEstimate:
        line, tone = best.line, best.tone
        scale = 2.0 * line.harmonic
        column = self._lines.index(line)
        return dataclasses.replace(
            blank,
            nominal_hz=line.nominal_hz,
            line_m=line.m,
            line_hz=line.line_hz(blank.frame_rate_hz),
            enf_hz=line.nominal_hz + tone.offset_hz / scale,
            enf_var_hz2=tone.offset_var_hz2 / scale**2 + SMEAR_STD_HZ**2,
            snr_db=_decibels(tone.snr),
            usable=True,
            **slow_time_amplitude(best, buffer, column, centre_s, self.settings.hop_s),
        )


def _decibels(ratio: float) -> float:
    return float(10.0 * np.log10(ratio)) if 0 < ratio < np.inf else float("nan")
