"""The paper's estimator: a sliding STFT at one line, refined by quadratic interpolation.

Section IV of the paper: 20 s windows, one value a second. The line is the strongest of the paper's
candidates (Eq. 21) in the first window in which one stands out, and is kept for the epoch.

Model: in a window, the frames' projection onto the line's ramp is ``c + A·exp(j·2π(k·f_0 + δ)t_n)``
plus white noise; the constant ``c`` is the picture's texture.

Statistic: the floating-mean periodogram under a Hann window (:mod:`rsenf.flicker.tone`); ``δ`` is
the vertex of a parabola through the logarithm of its peak, and the ENF's deviation ``δ / 2k``.

Approximate: the frequency is taken as constant in a window. Its weighted mean is off the middle
second's by 1.5 mHz rms, a fixed part of the standard error; what ramps disagree by beyond noise is
another. Nearer to 0 Hz than 1.5 cells tone and texture aren't separable: no estimate.

References
----------
- Garg, R., Varna, A. L., Hajj-Ahmad, A. and Wu, M. (2013), "Seeing" ENF: power-signature-based
  timestamp for digital multimedia via optical sensing and signal processing, IEEE TIFS 8.
- Zechmeister, M. and Kürster, M. (2009), The generalised Lomb-Scargle periodogram, A&A 496, 577.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.flicker.acquire import NO_FLICKER
from rsenf.flicker.lines import Line, candidate_lines, project, templates
from rsenf.flicker.mains import FAINT, UNUSUAL_HZ
from rsenf.flicker.tone import AT_EDGE, ToneFinder, decibels
from rsenf.messages import EnfEstimate, RowBlock
from rsenf.track.method import TrackSettings
from rsenf.track.sliding import MIN_AMPLITUDE_LEVEL, SlidingTracker, Window
from rsenf.track.window import LineFit, apart_hz2, fit_lines, slow_time_amplitude

# Standard deviation of a 20 s window's weighted mean frequency from the grid's mean over its middle
# second, measured on the first half of a day of the continental grid.
SMEAR_STD_HZ = 1.5e-3
# Nearer to 0 Hz than this (resolution cells) the tone, its mirror image and the constant aren't
# separable: errors came to 7 mHz at one cell, 0.3 mHz at one and a half. If the nominal's own alias
# is that near, a tone farther off is more likely such a confusion than the grid.
ZERO_CELLS = 1.5
# If 0 Hz is in the search band, brightness drift makes tones: flicker must stand out DRIFT_MARGIN
# times more there, and its power exceed the mirror image's by this factor.
MIN_ONE_SIDED = 10.0
OFTEN_HZ = 0.08  # common deviation of the illumination frequency from the nominal
TOO_NEAR = "alias too near 0 Hz, where the picture's texture hides it"
OVERTONE = (
    "near 0 Hz, and another line shows more at another frequency: an overtone or a mirror image"
)
MIRRORED = (
    "alias near 0 Hz, and the mirror image is nearer to the nominal frequency: read out from the "
    "last row to the first?"
)
DRIFT_MARGIN = 10.0


class StftTracker(SlidingTracker):
    """Sliding STFT at the strongest line, or at a given one.

    Parameters
    ----------
    settings : TrackSettings, optional
    """

    name = "stft"
    help = "reads the strongest line in windows of 20 s, as the paper's estimator does"

    def __init__(self, settings: TrackSettings | None = None) -> None:
        super().__init__(settings)
        s = self.settings
        self._finder = ToneFinder(s.window_s, 2.0 * s.search_hz * s.harmonic)
        self._followed: tuple[Line, ...] = ()
        self._lines: tuple[Line, ...] = ()  # those, and the ones to compare with
        self._ramps: NDArray[np.complex128] = np.empty((0, 0), np.complex128)
        self._chosen: Line | None = None

    def _candidates(self, nominal_hz: float, frame_rate_hz: float, rows: int) -> tuple[Line, ...]:
        """Lines that may be tracked."""
        lines = self._beside(nominal_hz, frame_rate_hz, rows)
        return tuple(x for x in lines if self.settings.line_m in (None, x.m))

    def _beside(self, nominal_hz: float, frame_rate_hz: float, rows: int) -> tuple[Line, ...]:
        """Lines to compare those with: the paper's, and those of a read-out upward."""
        harmonic = self.settings.harmonic
        lines = candidate_lines(nominal_hz, harmonic, frame_rate_hz, rows)
        if rows == 1:
            return lines
        first = int(lines[0].turns(frame_rate_hz)) + 1
        up = (Line(nominal_hz, harmonic, -m) for m in range(first, 2 * first + 1))
        return (*lines, *(x for x in up if -lines[0].carrier_hz <= x.line_hz(frame_rate_hz) < 0.0))

    def _prepare(self, first: RowBlock, frame_rate_hz: float) -> int:
        s = self.settings
        self._followed = tuple(
            line for n in s.nominals_hz for line in self._candidates(n, frame_rate_hz, first.rows)
        )
        if not self._followed:
            raise UsageError(
                f"no line {s.line_m} at {frame_rate_hz:.2f} frames/s and harmonic {s.harmonic}",
                "leave it out to follow the strongest",
            )
        beside = (x for n in s.nominals_hz for x in self._beside(n, frame_rate_hz, first.rows))
        self._lines = tuple(dict.fromkeys((*self._followed, *beside)))
        self._ramps = templates(self._lines, frame_rate_hz, first.rows, self._finder.search_hz)
        return len(self._lines)

    def _reduce(self, block: RowBlock) -> NDArray[np.complex128]:
        return project(block, self._ramps)

    def _tone_series(self, window: Window, found: EnfEstimate) -> NDArray[np.complex128]:
        assert self._chosen is not None
        column = self._lines.index(self._chosen)
        return np.asarray(window.buffer.values(window.part)[:, column], np.complex128)

    def _judge(self, window: Window, blank: EnfEstimate) -> EnfEstimate:
        rate_hz = window.frame_rate_hz
        among = (self._chosen,) if self._chosen else self._followed
        near_zero = any(self._near_zero(line, rate_hz) for line in among)
        lines = self._lines if near_zero else among
        columns = {line: self._lines.index(line) for line in lines}
        found = fit_lines(
            self._finder, window.buffer, columns, window.start_s, window.end_s, rate_hz
        )
        judged = [
            (self._why_unusable(fit, rate_hz) or self._why_another(fit, found, rate_hz), fit)
            for fit in found
            if fit.line in among
        ]
        reason, best = max(judged, key=lambda x: (not x[0], self._rank(x[1], rate_hz)))
        if reason:
            return dataclasses.replace(blank, snr_db=decibels(best.tone.snr), reason=reason)
        self._chosen = best.line
        return self._fill(blank, best, window)

    def _rank(self, fit: LineFit, rate_hz: float) -> tuple[bool, bool, float]:
        """Sort key: usable lines first, then those clear of 0 Hz, then the strongest.

        Near 0 Hz the line that best separates flicker from drift comes before a stronger one.
        """
        usable = not self._why_unusable(fit, rate_hz)
        near_zero = self._near_zero(fit.line, rate_hz)
        return usable, not near_zero, fit.one_sided if near_zero else fit.tone.snr

    def _near_zero(self, line: Line, rate_hz: float) -> bool:
        """Whether the search band includes 0 Hz, where brightness drift looks like a tone."""
        return abs(line.alias_hz(rate_hz)) <= self._finder.search_hz

    def _why_unusable(self, fit: LineFit, rate_hz: float) -> str:
        tone, near_zero = fit.tone, self._near_zero(fit.line, rate_hz)
        min_snr = self.settings.min_snr * (DRIFT_MARGIN if near_zero else 1.0)
        if tone.amplitude < MIN_AMPLITUDE_LEVEL or tone.snr < min_snr:
            return NO_FLICKER
        if self._is_faint(tone.amplitude, fit.line, tone.offset_hz):
            return FAINT
        if tone.at_edge:
            return AT_EDGE
        if self._rows == 1 and near_zero and not self.settings.nominal_hz:
            return "alias near 0 Hz, where brightness drifts: give the nominal frequency"
        if self._too_near_zero(fit, rate_hz):
            return TOO_NEAR
        if near_zero and (why := self._why_image(fit, rate_hz)):
            return why
        if self._rows > 1 and near_zero and fit.one_sided < MIN_ONE_SIDED:
            return "a slow change of brightness near 0 Hz, not to be told from flicker there"
        limit_hz = self.settings.max_std_hz * 2.0 * self.settings.harmonic
        if tone.offset_var_hz2 > limit_hz**2:
            return "too uncertain"
        return ""

    def _why_image(self, fit: LineFit, rate_hz: float) -> str:
        """Return why a tone near 0 Hz may be an image of one nearer to the nominal; else ''."""
        alias_hz, off_hz = fit.line.alias_hz(rate_hz), abs(fit.tone.offset_hz)
        if self._rows > 1 and fit.line.line_hz(rate_hz) < 0.0:
            return MIRRORED
        if off_hz > max(UNUSUAL_HZ, 2.0 * abs(self._mirrored_hz(fit, rate_hz))):
            return MIRRORED
        # The second harmonic turns twice as fast as the first.
        first_off_hz = abs((alias_hz + fit.tone.offset_hz) / 2.0 - alias_hz)
        return OVERTONE if off_hz > max(OFTEN_HZ, 2.0 * first_off_hz) else ""

    def _why_another(self, best: LineFit, found: list[LineFit], rate_hz: float) -> str:
        """Return why a tone near 0 Hz isn't the flicker's first harmonic; else ''.

        All lines of a harmonic share an alias. Overtones and mirror images are in the search band
        there. On some ramps down the rows they are stronger than the harmonic itself, but not on
        all.
        """
        if self._rows == 1 or not self._near_zero(best.line, rate_hz):
            return ""
        of_grid = [x for x in found if x.line.nominal_hz == best.line.nominal_hz]
        loudest = max(of_grid, key=lambda fit: fit.tone.amplitude)
        if self._too_near_zero(loudest, rate_hz):
            return TOO_NEAR
        # The mirror image of light on one ramp is on the opposite ramp.
        images = loudest.tone.offset_hz, self._mirrored_hz(loudest, rate_hz)
        apart_hz = min(abs(image_hz - best.tone.offset_hz) for image_hz in images)
        return OVERTONE if apart_hz > 1.0 / self.settings.window_s else ""

    @staticmethod
    def _mirrored_hz(fit: LineFit, rate_hz: float) -> float:
        """Offset of the tone's mirror image about 0 Hz."""
        return -2.0 * fit.line.alias_hz(rate_hz) - fit.tone.offset_hz

    def _too_near_zero(self, fit: LineFit, rate_hz: float) -> bool:
        """Whether the texture hides the tone, or the nominal frequency's own alias."""
        alias_hz = fit.line.alias_hz(rate_hz)
        nearest_hz = min(abs(alias_hz), abs(alias_hz + fit.tone.offset_hz))
        return nearest_hz < ZERO_CELLS / self.settings.window_s

    def _fill(self, blank: EnfEstimate, best: LineFit, window: Window) -> EnfEstimate:
        line, tone = best.line, best.tone
        scale = 2.0 * line.harmonic
        column = self._lines.index(line)
        ramps = [i for i, x in enumerate(self._lines) if x.carrier_hz == line.carrier_hz]
        apart2 = apart_hz2(
            window.buffer.values(window.part)[:, ramps],
            ramps.index(column),
            window.buffer.times(window.part) - window.centre_s,
            line.carrier_hz + tone.offset_hz,
            self.settings.window_s,
        )
        beyond_noise_hz2 = max(apart2 - 2.0 * tone.offset_var_hz2, 0.0)
        return dataclasses.replace(
            blank,
            nominal_hz=line.nominal_hz,
            line_m=line.m,
            line_hz=line.line_hz(blank.frame_rate_hz),
            enf_hz=line.nominal_hz + tone.offset_hz / scale,
            enf_var_hz2=(tone.offset_var_hz2 + beyond_noise_hz2) / scale**2 + SMEAR_STD_HZ**2,
            snr_db=decibels(tone.snr),
            usable=True,
            **slow_time_amplitude(
                best, window.buffer, column, window.centre_s, self.settings.hop_s
            ),
        )
