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

from rsenf.messages import EnfEstimate, Header, RowBlock
from rsenf.timebase import nanoseconds
from rsenf.track.lines import Line, candidate_lines, project, templates
from rsenf.track.settings import TrackSettings
from rsenf.track.slow_time import SlowTime
from rsenf.track.tone import Tone, ToneFinder

# Row blocks held back until the frame rate is known well enough for the phase ramps.
RATE_NEEDS_S = 1.0
# A 20 s window reports a weighted mean of the grid's frequency; a value for its middle second
# differs from it by this much, measured on the first half of a day of the continental grid.
SMEAR_STD_HZ = 1.5e-3
# Weaker than this (levels) is rounding, not light.
MIN_AMPLITUDE_LEVEL = 1e-4
MIN_FILL_RATIO = 0.8


@dataclasses.dataclass(frozen=True)
class _Window:
    """Everything found in one window for one line."""

    line: Line
    tone: Tone
    constant: complex
    noise_level2: float  # noise power per frame


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
        t_s = buffer.times(part) - (start_s + end_s) / 2.0
        lines = (self._chosen,) if self._chosen else self._lines
        found = self._windows(buffer, part, t_s, lines)
        best = max(found, key=lambda w: (not self._why_unusable(w, rate_hz), w.tone.snr))
        reason = self._why_unusable(best, rate_hz)
        if not reason:
            self._chosen = best.line
        return self._fill(blank, best, reason, buffer, (start_s + end_s) / 2.0)

    def _windows(
        self, buffer: SlowTime, part: slice, t_s: NDArray[np.float64], lines: tuple[Line, ...]
    ) -> list[_Window]:
        """Fit every line. Lines of one carrier share their rotations."""
        out = []
        weights = self._finder.window(t_s)
        for carrier_hz in dict.fromkeys(line.carrier_hz for line in lines):
            group = [line for line in lines if line.carrier_hz == carrier_hz]
            columns = [self._lines.index(line) for line in group]
            carrier = np.exp(-2j * np.pi * carrier_hz * buffer.times(part))
            baseband = buffer.values(part)[:, columns] * carrier[:, None]
            amplitude, power = self._finder.periodograms(baseband, carrier, t_s)
            means = (weights * carrier.conj()) @ baseband
            for i, line in enumerate(group):
                tone = self._finder.strongest(power[:, i], t_s)
                peak = int(np.argmax(power[:, i]))
                turn = np.exp(2j * np.pi * self._finder.offsets_hz[peak] * t_s)
                overlap = (weights * carrier.conj()) @ turn
                noise = tone.amplitude**2 / tone.snr / (weights @ weights) if tone.snr else 0.0
                constant = complex(means[i] - amplitude[peak, i] * overlap)
                out.append(_Window(line, tone, constant, float(noise)))
        return out

    def _why_unusable(self, window: _Window, rate_hz: float) -> str:
        tone = window.tone
        if tone.amplitude < MIN_AMPLITUDE_LEVEL or tone.snr < self.settings.min_snr:
            return "no mains flicker stands out"
        if tone.at_edge:
            return "strongest at the edge of the search band"
        near_zero = abs(window.line.alias_hz(rate_hz)) <= self._finder.search_hz
        if self._rows == 1 and near_zero and not self.settings.nominal_hz:
            return "alias near 0 Hz, where brightness drifts: give the nominal frequency"
        limit_hz = self.settings.max_std_hz * 2.0 * self.settings.harmonic
        if tone.offset_var_hz2 > limit_hz**2:
            return "too uncertain"
        return ""

    def _blank(self, buffer: SlowTime, start_s: float, end_s: float, rate_hz: float) -> EnfEstimate:
        assert self._header is not None
        start_ns, end_ns = (buffer.origin_ns + nanoseconds(t) for t in (start_s, end_s))
        header = dataclasses.replace(
            self._header,
            seq=self._hops,
            pts_ns=start_ns,
            camera_time_ns=0,
            frame_first=-1,
            frame_last=-1,
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
        self, blank: EnfEstimate, best: _Window, reason: str, buffer: SlowTime, centre_s: float
    ) -> EnfEstimate:
        line, tone = best.line, best.tone
        scale = 2.0 * line.harmonic
        common: dict[str, Any] = {
            "nominal_hz": line.nominal_hz,
            "snr_db": float(10.0 * np.log10(tone.snr)) if 0 < tone.snr < np.inf else float("nan"),
            "reason": reason,
            "usable": not reason,
        }
        if reason:
            return dataclasses.replace(blank, **common)
        return dataclasses.replace(
            blank,
            **common,
            line_m=line.m,
            line_hz=line.line_hz(blank.frame_rate_hz),
            enf_hz=line.nominal_hz + tone.offset_hz / scale,
            enf_var_hz2=tone.offset_var_hz2 / scale**2 + SMEAR_STD_HZ**2,
            **self._amplitude(best, buffer, centre_s),
        )

    def _amplitude(self, best: _Window, buffer: SlowTime, centre_s: float) -> dict[str, Any]:
        """Complex amplitude over the window's middle hop, its texture taken off."""
        hop_s = self.settings.hop_s
        part = buffer.between(centre_s - hop_s / 2, centre_s + hop_s / 2)
        count = part.stop - part.start
        if count == 0:
            return {}
        column = self._lines.index(best.line)
        carrier = np.exp(-2j * np.pi * best.line.carrier_hz * buffer.times(part))
        amplitude = np.mean((buffer.values(part)[:, column] - best.constant) * carrier)
        variance = np.array([best.noise_level2 / (2.0 * count)])
        return {
            "carrier_hz": best.line.carrier_hz,
            "points": 1,
            "amplitude_pts_ns": np.array([buffer.origin_ns + nanoseconds(centre_s)]),
            "amplitude_re": np.array([amplitude.real]),
            "amplitude_im": np.array([amplitude.imag]),
            "amplitude_var_re": variance,
            "amplitude_var_im": variance,
            "amplitude_cov": np.zeros(1),
        }
