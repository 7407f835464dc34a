"""Phase tracker: follows detected flicker from second to second.

Model: that of :mod:`rsenf.flicker.phase_fit`, in windows of 31 s, each refitted from the previous
estimate. Several consecutive seconds share a window, since the fits are most of the work.

Statistic: the posterior mode; and, as a check, the floating-mean periodogram of the rows projected
onto the flicker's shape so far: its peak must stand out, within a cell of the fitted frequency.

Approximate: windows are independent of each other but for the first guess; lost frames are sought
by alternating with the fit. Where the flicker's amplitude differs from the window's, the standard
error is widened by a factor.

References
----------
- Rife, D. C. and Boorstyn, R. R. (1974), Single tone parameter estimation from discrete-time
  observations, IEEE Trans. Information Theory 20.
- Zechmeister, M. and Kürster, M. (2009), The generalised Lomb-Scargle periodogram, A&A 496, 577.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.acquire import NO_FLICKER, SEARCH_HZ, AcquiredFlicker, stands_out, strongest
from rsenf.flicker.cell_light import bands_of, look_at
from rsenf.flicker.frame_slips import FrameSlip
from rsenf.flicker.grid_prior import MODEL_STD_HZ, NODES_PER_S, Wander, phase_prior, wander_of
from rsenf.flicker.lines import SURE_LOG_ODDS, ProfileBasis, alias_hz, mirror_hz, usual_log_odds
from rsenf.flicker.mains import PATTERN, SECOND, why_not
from rsenf.flicker.phase_fit import PhaseFit, PhasePath
from rsenf.flicker.phase_likelihood import at_frames
from rsenf.flicker.second import FlickerSecond
from rsenf.flicker.slipping_fit import SlipWindow
from rsenf.flicker.slow_time import SlowTime
from rsenf.flicker.tone import AT_EDGE, Tone, ToneFinder, decibels, turning

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

WINDOW_S = 31  # length of a fit
AHEAD_S = 15  # part of it after the first second that it serves
TOGETHER_S = 6  # seconds that share a fit
SHORT_S = 3  # shortest fit
JUDGED_S = 12  # windows that begin within this time share one test for mains light
CHECK_S = 20  # window in which the tone has to stand out
MIN_FILL_RATIO = 0.5
TOO_FEW = "too few frames are usable"
# Largest distance of the tone from the fitted frequency, in resolution cells.
MAX_OFF_CELLS = 1.0
# Factor of the detection threshold while tracking: the tone is sought in one place only.
HELD = 0.8
MEMORY = 0.1  # weight of a new second in the template of the check
# A codec that passes more or less of the flicker than around also turns its phase: the standard
# error grows by this factor per unit of |ln gain|. Below the least gain nothing is reported.
UNSETTLED, MIN_GAIN = 4.0, 0.6
# At the ends of the data the phase is constrained from one side only, and the noise may differ from
# that in the middle, which its variance rests on: more than this multiple of the least variance
# isn't used, unless it is small (Hz). And how far an end reaches.
LEAST_SURE, SURE_STD_HZ = 3.0, 1e-3
END_S = 5
# A lamp's second harmonic over its first: rarely larger, but about half for light at half f_0.
MOST_SECOND = 0.35
# Part at half the frequency (the grid's own) over the first harmonic: beyond, it may be the first.
MOST_HALF = 0.1
APART_CELLS = 1.0  # resolution cells between separable tones
# Largest difference between turns by bands of rows and by smooth profiles: finer texture differs.
MOST_TURNS_APART = 0.75
HALF = "light at the grid's own frequency, or a read-out from the last row to the first: which?"


class PhaseTracker:
    """Tracks flicker from where it was detected.

    Parameters
    ----------
    found : AcquiredFlicker
        The detection.
    start : int
        First second of its window.
    basis : ProfileBasis
    frame_rate_hz : float
        Frame rate of the camera.
    shown_hz : float
        Rate of distinct frames received.
    min_snr : float
        Detection threshold.
    cells : SlowTime
        Cell means of the same frames (:func:`rsenf.flicker.cell_light.cell_means`).
    ramp : ndarray of complex, shape (columns,), optional
        Reference of the phase: that of an earlier tracker of the same light.
    """

    def __init__(
        self,
        found: AcquiredFlicker,
        start: int,
        basis: ProfileBasis,
        frame_rate_hz: float,
        shown_hz: float,
        min_snr: float,
        cells: SlowTime,
        ramp: Complex | None = None,
    ) -> None:
        self.nominal_hz, self.turns = found.nominal_hz, found.turns
        straight = basis.ramps(np.array([found.turns]))[:, 0]
        self.ramp: Complex = straight if ramp is None else ramp
        self._rate_hz, self._shown_hz, self._min_snr = frame_rate_hz, shown_hz, min_snr
        self._basis, self._cells = basis, cells
        self._seen: Complex = np.zeros_like(straight)  # sum of good templates, in phase
        self._template: Complex = straight / np.linalg.norm(straight)
        self._path = PhasePath(found.psi_rad, start)
        self._fit: tuple[tuple[int, int], PhaseFit | None] = (0, 0), None
        self._checked: tuple[tuple[int, int], tuple[Tone, str]] = (0, 0), (_NO_TONE, TOO_FEW)
        self._alternates: tuple[tuple[int, int], str] = (0, 0), ""
        self.failed = 0  # consecutive seconds in which the tone didn't stand out
        self.settled_s = 0  # no new slips are sought before this second
        self._apart_turns = 0.0
        self._is_grids = False  # whether a grid's wander has been seen
        self._judged: tuple[int, str] = -JUDGED_S, ""  # last test for mains light: start, result

    def extend(self, buffer: SlowTime, start: int, end: int) -> PhaseFit | None:
        """Fit the phase over a span, from the path known so far; None without enough frames."""
        if self._fit[0] == (start, end):
            return self._fit[1]
        fit = self._fitted(buffer, start, end, self._path.between(start, end))
        if fit is not None:
            fit = self._aligned(fit)
            self._path.set(start, fit.psi_rad)
        self._fit = (start, end), fit
        return fit

    def _fitted(self, buffer: SlowTime, start: int, end: int, guess_rad: Float) -> PhaseFit | None:
        """Fit the phase near a guess, jointly with frame slips, which are then corrected."""
        t_s, columns = buffer.usable_of(start, end)
        if t_s.size <= (end - start) / 2:
            return None
        part = buffer.between(start, end)
        period_s, first = buffer.period_s(part), int(t_s.searchsorted(self.settled_s))
        window = SlipWindow(
            t_s, columns, start, period_s, self.nominal_hz, guess_rad, self._basis, self.turns
        )  # fmt: skip
        fit, slips = window.fit(first)
        numbers = buffer.numbers(part)[buffer.usable(part)]
        for at, late_frames in slips:
            for values in (buffer, self._cells):
                values.slip(FrameSlip(int(numbers[at]), late_frames), period_s)
        return fit

    def around(self, buffer: SlowTime, index: int, end: int) -> tuple[int, int, PhaseFit | None]:
        """Fit the window around one second, of the frames before second ``end``.

        Returns its start and stop, and the fit. Frame slips in it are corrected.
        """
        start = max(min(index + 1 + AHEAD_S, end) - WINDOW_S, int(buffer.first_t_s))
        stop = min(start + WINDOW_S, end)
        # After a long gap the buffer may begin at the window's end, or later.
        return start, stop, self.extend(buffer, start, stop) if stop - start >= SHORT_S else None

    def second(self, buffer: SlowTime, blank: FlickerSecond, end: int) -> FlickerSecond:
        """Fill in one second from the window around it, of the frames before second ``end``."""
        index = blank.index
        start, stop, fit = self.around(buffer, index, end)
        blank = dataclasses.replace(blank, nominal_hz=self.nominal_hz, turns=self.turns)
        if fit is None:
            return dataclasses.replace(blank, reason=TOO_FEW)
        check_from = max(min(_middle(index) - CHECK_S // 2, stop - CHECK_S), start)
        tone, reason = self._check(buffer, check_from, min(check_from + CHECK_S, stop))
        self.failed = self.failed + 1 if reason else 0
        self._path.forget_before(start)
        if not reason:
            self._learn(fit)
            if self._alternates[0] != (start, stop):
                self._alternates = (start, stop), self._why_alternates(buffer, fit, start, stop)
            reason = self._why_mirrored(fit) or self._alternates[1]
        blank = dataclasses.replace(
            blank,
            turns=self.turns,
            apart_turns=self._apart_turns,
            snr_db=decibels(tone.snr),
            reason=reason,
        )
        return blank if reason else self._filled(buffer, blank, fit, start)

    def _filled(
        self, buffer: SlowTime, blank: FlickerSecond, fit: PhaseFit, start: int
    ) -> FlickerSecond:
        part = buffer.between(blank.index, blank.index + 1)
        if part.stop == part.start:
            return dataclasses.replace(blank, reason=TOO_FEW)
        node, psi = (blank.index - start) * NODES_PER_S, fit.psi_rad
        gain = float(np.mean(fit.gain[node : node + NODES_PER_S]))
        if gain < MIN_GAIN:
            return dataclasses.replace(blank, reason="the flicker is much weaker than around")
        unsettled = 1.0 + UNSETTLED * abs(np.log(gain))
        variance = float(fit.second_var_hz2[node]) * unsettled**2 + MODEL_STD_HZ**2
        if (made := buffer.conversion) is not None:
            variance += (2.0 * self.nominal_hz * made.source_std_hz / made.source_hz) ** 2
        least = float(np.min(fit.second_var_hz2)) + SURE_STD_HZ**2
        from_end = min(blank.index - start, psi.size // NODES_PER_S - 1 - (blank.index - start))
        if from_end < END_S and variance > LEAST_SURE * least:
            return dataclasses.replace(blank, reason="much less sure than what lies beside it")
        turns = float(psi[node + NODES_PER_S] - psi[node]) / (2.0 * np.pi)
        t_s = buffer.times(part)
        return dataclasses.replace(
            blank,
            usable=True,
            f0_hz=2.0 * self.nominal_hz + turns,
            mirror_hz=self._mirror_hz(turns),
            f0_var_hz2=variance,
            phase_rad=4.0 * np.pi * self.nominal_hz * t_s + at_frames(t_s - start, psi),
            **self._amplitude(blank.index, fit, start),
        )

    def _mirror_hz(self, off_hz: float) -> float:
        """Frequency about which the light's is mirrored; NaN if the mirror image is unlikely."""
        about_hz = mirror_hz(self.nominal_hz, self._rate_hz)
        other_off_hz = 2.0 * (about_hz - 2.0 * self.nominal_hz) - off_hz
        is_known = abs(usual_log_odds(off_hz, other_off_hz)) > SURE_LOG_ODDS
        return math.nan if is_known else about_hz

    def _amplitude(self, index: int, fit: PhaseFit, start: int) -> dict[str, Any]:
        """Amplitude over one second: the model's, and the residual of the second's frames."""
        first, stop = fit.t_s.searchsorted([index - start, index + 1 - start])
        information = fit.information[(index - start) * NODES_PER_S :][:NODES_PER_S].sum()
        if first == stop or not information > 0.0:
            return {}
        middle = float(fit.psi_rad[(index - start) * NODES_PER_S + NODES_PER_S // 2])
        size = self._size(fit)
        return {
            "amplitude": complex(
                size * np.exp(1j * middle) * (1.0 + np.mean(fit.deviation[first:stop]))
            ),
            "amplitude_var": float(size**2 / information),
        }

    def _size(self, fit: PhaseFit) -> float:
        """Amplitude of the flicker, in levels."""
        ramp = self._basis.ramps(np.array([self.turns]))[:, 0]
        return float(np.abs(ramp.conj() @ fit.template) / np.sum(np.abs(ramp) ** 2))

    @property
    def level(self) -> float:
        """Amplitude of the flicker in the last fit, in levels; 0 without one."""
        return self._size(self._fit[1]) if self._fit[1] else 0.0

    def _check(self, buffer: SlowTime, start: int, end: int) -> tuple[Tone, str]:
        """Tone in a window, and why it doesn't count or ''; the last result is cached."""
        if self._checked[0] != (start, end):
            self._checked = (start, end), self._checked_anew(buffer, start, end)
        return self._checked[1]

    def _checked_anew(self, buffer: SlowTime, start: int, end: int) -> tuple[Tone, str]:
        t_s, columns = buffer.usable_of(start, end)
        if t_s.size < MIN_FILL_RATIO * self._shown_hz * (end - start):
            return _NO_TONE, TOO_FEW
        finder, t_mid = ToneFinder(float(end - start), SEARCH_HZ), t_s - (start + end) / 2.0
        carrier = np.exp(-4j * np.pi * self.nominal_hz * t_s)
        series = (columns @ self._template.conj()) * carrier
        _, power = finder.periodograms(series[:, None], carrier, t_mid)
        tone = strongest(finder, power[:, 0], t_mid)
        psi = self._path.between(start, end)
        slope_hz = float(psi[-1] - psi[0]) / (2.0 * np.pi * (end - start))
        if not stands_out(tone, HELD * self._min_snr):
            return tone, NO_FLICKER
        if tone.at_edge:
            return tone, AT_EDGE
        if abs(tone.offset_hz - slope_hz) * (end - start) > MAX_OFF_CELLS:
            return tone, "the phase was lost"
        if not self._judged[0] <= start < self._judged[0] + JUDGED_S:
            self._judged = start, self.why_not_mains(start, end)
        return tone, self._judged[1]

    def why_not_mains(self, start: int, end: int) -> str:
        """Return why the signal tracked in a window isn't mains light; '' if it may be."""
        psi = self._path.between(start, end)
        f0_hz = 2.0 * self.nominal_hz + float(psi[-1] - psi[0]) / (2.0 * np.pi * (end - start))
        light = None
        if self._basis.rows > 1:
            t_s, seen = self._cells.usable_of(start, end)
            phase = 4.0 * np.pi * self.nominal_hz * t_s + at_frames(t_s - start, psi)
            bands = bands_of(self._basis.rows)
            light = look_at(seen, t_s, phase, bands, f0_hz, self._rate_hz)
            self._apart_turns = light.apart_turns
            if abs(light.turns - self.turns) > MOST_TURNS_APART:
                return PATTERN  # as fine as the bands: their ramp is another one
        wander = self._wander()
        self._is_grids |= wander.is_grids
        unfiltered = self._cells.unfiltered(self._cells.between(start, end))
        return why_not(
            f0_hz, self.nominal_hz, self._rate_hz, wander, light,
            unfiltered=unfiltered, has_moved=self._is_grids,
        )  # fmt: skip

    def _wander(self) -> Wander:
        """Wander of the last fit's phase."""
        fit = self._fit[1]
        if fit is None:
            return Wander()
        prior = phase_prior(fit.psi_rad.size)
        return wander_of(prior.nearest(fit.psi_rad), prior.precision(fit.information), prior.nodes)

    def _why_mirrored(self, fit: PhaseFit) -> str:
        """Return why another order of the light may be tracked, mirrored; else ''.

        At 30 frames/s light at 50 Hz has the alias of 100 Hz with its sign reversed, and half the
        turns: it looks like flicker read out from the last row to the first, and the true flicker
        like its second harmonic. The same holds for light at 200 Hz, with twice the turns, and the
        true flicker then looks like a part at half its frequency.
        """
        if self.turns >= 0.0:
            return ""
        for order, ratio, most, reason in (
            (0.5, fit.second_ratio, MOST_SECOND, HALF),
            (2.0, fit.half_ratio, MOST_HALF, SECOND),
        ):
            apart_hz = alias_hz(2.0 * self.nominal_hz * (1.0 + order), self._rate_hz)
            if abs(apart_hz) < SEARCH_HZ and ratio > most:
                return reason
        return ""

    def _why_alternates(self, buffer: SlowTime, fit: PhaseFit, start: int, stop: int) -> str:
        """Return why the true flicker may be at half the tracked frequency; else ''.

        At 60 frames/s light at 200 Hz has the alias of 100 Hz with its sign reversed. The true
        flicker is then at half the tracked frequency, with a sign that alternates between frames.
        """
        sum_hz = 6.0 * self.nominal_hz  # of light at 2·f_0, and of the mirrored f_0
        apart_hz, is_odd = alias_hz(sum_hz, self._rate_hz) / 2.0, round(sum_hz / self._rate_hz) % 2
        if not (is_odd and APART_CELLS / (stop - start) < abs(apart_hz) < SEARCH_HZ / 2.0):
            return ""
        t_s, columns = buffer.usable_of(start, stop)
        phase = 4.0 * np.pi * self.nominal_hz * t_s + at_frames(t_s - start, fit.psi_rad)
        sign = 1.0 - 2.0 * (np.rint(t_s * self._rate_hz) % 2.0)
        of_frames = [sign * turning(0.5 * phase), *(turning(k * phase) for k in (1.0, 2.0, 3.0))]
        waves = np.stack([np.ones_like(t_s), *(w for f in of_frames for w in (f.real, f.imag))], 1)
        found = np.linalg.solve(waves.T @ waves, waves.T @ columns)
        half, first = (fit.weights @ (found[k] ** 2 + found[k + 1] ** 2) for k in (1, 3))
        noise = 4.0 * fit.weights.size / t_s.size
        return SECOND if half - noise > MOST_HALF**2 * first else ""

    def _aligned(self, fit: PhaseFit) -> PhaseFit:
        """Return a fit with its template in phase with the ramp: a constant no fit can know."""
        turn = np.sum(fit.weights * self.ramp.conj() * fit.template)
        if not abs(turn) > 0.0:
            return fit
        turn /= abs(turn)
        psi = fit.psi_rad + float(np.angle(turn))
        return dataclasses.replace(fit, psi_rad=psi, template=fit.template * turn.conjugate())

    def _learn(self, fit: PhaseFit) -> None:
        """Update the turns, and the template of the check, with a good second."""
        self._seen = self._seen + fit.template
        if self._basis.rows > 1:
            self.turns = self._basis.turns_of(self._seen)
        new = fit.template * fit.weights
        size = np.linalg.norm(new)
        if size > 0.0:
            mixed = self._template + MEMORY * (new / size - self._template)
            self._template = mixed / np.linalg.norm(mixed)


_NO_TONE = Tone(0.0, np.inf, 0.0, 0.0, at_edge=False)


def _middle(index: int) -> int:
    """Middle of the seconds that share a fit window with this one."""
    first = index - (index + 1 + AHEAD_S - WINDOW_S) % TOGETHER_S
    return first + TOGETHER_S // 2
