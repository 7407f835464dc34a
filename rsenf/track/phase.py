"""ENF from phase steps between averages of frames, over an interval that adapts to the noise.

Model: a frame's phasor ``z`` is its row profile's projection onto the strongest of the paper's
ramps, less texture, rotated back by the window's spectral peak: ``A·exp(jφ)`` plus noise. A Hann
taper over the rows suppresses the other harmonics and the ramp's mirror image. Frames are averaged
under Hann windows that overlap by half: of half a second, or longer where noise swamps a step.

Statistic: ``δ = arg Σ_n w_n·z_{n+1}·conj(z_n) / 2πΔt`` over an interval, with the squares of Kay's
parabolic weights, which give less weight to its ends, where the grid has moved on. The interval of
least error is used. Frame times are exact, and an average counts at the mean time of its frames.

Approximate: the noise is taken as white up to 1.2 Hz beside the tone. The error by a grid's own
change is from a fixed table by length, that by leakage is what other ramps disagree by.

References
----------
- Han, H., Jeon, Y., Song, B. and Yoon, J. W. (2022), A phase-based approach for ENF signal
  extraction from rolling shutter videos, IEEE Signal Processing Letters 29.
- Kay, S. (1989), A fast and accurate single frequency estimator, IEEE Trans. ASSP 37.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import Line
from rsenf.flicker.tone import ToneFinder
from rsenf.messages import EnfEstimate, RowBlock
from rsenf.timebase import nanoseconds
from rsenf.track.alias import is_folded
from rsenf.track.method import TrackSettings
from rsenf.track.sliding import Window
from rsenf.track.stft import StftTracker
from rsenf.track.window import MIN_SHARE, OVERLAP, LineFit, averages

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Half the length of the Hann windows: the step from one average to the next.
STEPS_S = (0.25, 0.5, 1.0, 2.0)
# Least power of an average over its noise; else a longer one is used.
MIN_STEP_SNR = 30.0
# Lengths of the interval: steps on either side of the centre.
HALF_STEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 38)
# Offsets from the tone at which noise is measured: beyond its spread by the grid's changes.
NOISE_HZ = np.arange(0.4, 1.2, 0.05)
# Amplitude of the mirror image over the flicker's, above which the other harmonics' images are
# there too, some of them so near that only the longest interval separates them.
MAX_MIRROR = 0.3
# Deviation of a parabolic mean over an interval from the grid's mean over its middle second: length
# (s) and standard deviation (mHz), measured on the first half of a day of the continental grid.
SMEAR_S = (1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0)
SMEAR_MHZ = (0.016, 0.056, 0.155, 0.38, 0.74, 1.19, 2.12)
# Lengths of parabolas with the second moment of a squared parabola, over its length; and with that
# of the averages' Hann window, over the step.
SPREAD, HANN_SPREAD = np.sqrt(20.0 / 28.0), 1.6


@dataclasses.dataclass(frozen=True)
class _Step:
    """Frequency offset by phase steps from the window's tone; its variance, and the interval."""

    offset_hz: float
    var_hz2: float
    length_s: float


class PhaseStepTracker(StftTracker):
    """Phase steps over an adaptive interval; window and line are those of the STFT."""

    name = "phase"
    help = "reads the phase's step down the stream, over intervals that adapt (Han 2022)"

    def __init__(self, settings: TrackSettings | None = None) -> None:
        super().__init__(settings)
        self._apart: dict[int, tuple[float, int]] = {}  # disagreement by steps: sum and count

    def _candidates(self, nominal_hz: float, frame_rate_hz: float, rows: int) -> tuple[Line, ...]:
        """Ramps in both directions, since the read-out may run upward, of a turn at least.

        With less, a ramp's mirror image is within the width of the Hann taper.
        """
        if rows == 1:
            return super()._candidates(nominal_hz, frame_rate_hz, rows)
        base = Line(nominal_hz, self.settings.harmonic, 0)
        most = max(2.0 * base.turns(frame_rate_hz), 2.0)
        reach = int(1.5 * most) + 1
        lines = [dataclasses.replace(base, m=m) for m in range(-reach, reach + 1)]
        return tuple(
            x
            for x in lines
            if 1.0 <= abs(x.turns(frame_rate_hz)) <= most and self.settings.line_m in (None, x.m)
        )

    def _beside(self, nominal_hz: float, frame_rate_hz: float, rows: int) -> tuple[Line, ...]:
        return ()

    def _rank(self, fit: LineFit, rate_hz: float) -> tuple[bool, bool, float]:
        """By amplitude: under strong light a mirror image has as high an SNR as its original."""
        usable, clear, _ = super()._rank(fit, rate_hz)
        return usable, clear, fit.tone.amplitude

    def _prepare(self, first: RowBlock, frame_rate_hz: float) -> int:
        lines = super()._prepare(first, frame_rate_hz)
        if first.rows > 1:
            place = (np.arange(first.rows) + 0.5) / first.rows
            taper = np.sin(np.pi * place) ** 2
            self._ramps = self._ramps * (taper / taper.mean())[:, None]
        return lines

    def _why_unusable(self, fit: LineFit, rate_hz: float) -> str:
        if is_folded(fit.line, rate_hz, 0.5 / STEPS_S[0]):
            return "the phase turns too slowly from frame to frame to tell its mirror image apart"
        return super()._why_unusable(fit, rate_hz)

    def _fill(self, blank: EnfEstimate, best: LineFit, window: Window) -> EnfEstimate:
        estimate = super()._fill(blank, best, window)
        scale = 2.0 * best.line.harmonic
        step = self._step(best, window, scale)
        if step is None:
            return dataclasses.replace(blank, reason="too many frames lost around the middle")
        if step.var_hz2 > self.settings.max_std_hz**2:
            return dataclasses.replace(blank, snr_db=estimate.snr_db, reason="too uncertain")
        origin_ns = window.buffer.origin_ns
        return dataclasses.replace(
            estimate,
            start_pts_ns=origin_ns + nanoseconds(window.centre_s - step.length_s / 2.0),
            end_pts_ns=origin_ns + nanoseconds(window.centre_s + step.length_s / 2.0),
            enf_hz=estimate.enf_hz + step.offset_hz / scale,
            enf_var_hz2=step.var_hz2,
        )

    def _step(self, best: LineFit, window: Window, scale: float) -> _Step | None:
        """Best interval around the window's centre; variances are of the grid's frequency."""
        part = window.part
        t_s = window.buffer.times(part)
        turn_hz = best.line.carrier_hz + best.tone.offset_hz
        column = self._lines.index(best.line)
        turning = np.exp(-2j * np.pi * turn_hz * t_s)[:, None]
        lines = [i for i, x in enumerate(self._lines) if x.carrier_hz == best.line.carrier_hz]
        every = window.buffer.values(part)[:, lines]
        values = every[:, lines.index(column)] - best.constant
        phasors = values * turning[:, 0]
        t_s = t_s - window.centre_s
        noise_of_shortest = None
        longest_s = max(self.settings.window_s / 4.0, STEPS_S[0])  # two on either side
        for step_s in (step_s for step_s in STEPS_S if step_s <= longest_s):
            half = max(int((self.settings.window_s / 2.0) / step_s) - 1, 0)
            z, at_s, filled = averages(phasors, t_s, step_s, half)
            if noise_of_shortest is None:
                noise_of_shortest = _noise_level2(self._finder, z[filled], at_s[filled])
            noise_z = noise_of_shortest * STEPS_S[0] / step_s
            if best.tone.amplitude**2 >= MIN_STEP_SNR * noise_z:
                break
        halves = [m for m in HALF_STEPS if m <= half]
        if _is_mirrored(values, best.tone.amplitude):
            halves = halves[-1:]
        steps = {m: _over_interval(z, at_s, filled, m, step_s, noise_z, scale) for m in halves}
        known = {m: step for m, step in steps.items() if step}
        if not known:
            return None
        m, step = min(known.items(), key=lambda x: x[1].var_hz2)
        others = (every - every.mean(axis=0)) * turning
        apart_hz2 = self._apart_hz2(best, others, t_s, step_s, m, step) / scale**2
        return dataclasses.replace(step, var_hz2=step.var_hz2 + apart_hz2)

    def _apart_hz2(
        self, best: LineFit, phasors: Complex, t_s: Float, step_s: float, m: int, step: _Step
    ) -> float:
        """Mean square disagreement of other ramps about an interval of ``m`` steps.

        They share the flicker, but not the leakage of overtones and their images. The error of a
        ramp is scaled by its relative amplitude.
        """
        amplitude = np.abs(np.average(phasors, axis=0, weights=self._finder.window(t_s)))
        share = amplitude / best.tone.amplitude
        half = int((self.settings.window_s / 2.0) / step_s) - 1
        far = [0.0]
        for c in np.flatnonzero(share > MIN_SHARE):
            z, at_s, filled = averages(phasors[:, c], t_s, step_s, half)
            other = _over_interval(z, at_s, filled, m, step_s, 0.0, 1.0)
            if other:
                far.append(float(share[c]) ** 2 * (other.offset_hz - step.offset_hz) ** 2)
        return self._remembered(m, sum(far) / max(len(far) - 1, 1))

    def _remembered(self, m: int, apart_hz2: float) -> float:
        """The disagreement, or its mean so far if larger: leakage beats, and vanishes at times."""
        total, count = self._apart.get(m, (0.0, 0))
        self._apart[m] = total + apart_hz2, count + 1
        return max(apart_hz2, (total + apart_hz2) / (count + 1))


def _noise_level2(finder: ToneFinder, z: Complex, t_s: Float) -> float:
    """Noise power of the shortest averages (levels²), from their spectrum beside the tone.

    Not from that of the frames: lost frames give a tone's spectrum a floor. What the Hann window
    takes from the noise there equals what the overlap adds to it, to within a tenth.
    """
    weights = finder.window(t_s)
    turns = np.exp(-2j * np.pi * np.outer(np.concatenate((-NOISE_HZ, NOISE_HZ)), t_s))
    power = np.abs(turns @ (weights * z)) ** 2
    return float(np.mean(power) / (weights @ weights))


def _is_mirrored(values: Complex, amplitude: float) -> bool:
    """Whether the phasors hold the flicker's mirror image: all rows flicker nearly in phase.

    The mean square of ``A·exp(jθ) + B·exp(−jθ)`` is ``2·A·B``, that of noise is 0 on average.
    """
    power = amplitude**2
    noise = max(float(np.mean(np.abs(values) ** 2)) - power, 0.0)
    image = 0.5 * abs(np.mean(values**2))
    return bool(image > MAX_MIRROR * power + 2.0 * noise / np.sqrt(values.size))


def _over_interval(
    z: Complex,
    at_s: Float,
    filled: NDArray[np.bool_],
    half: int,
    step_s: float,
    noise_z: float,
    scale: float,
) -> _Step | None:
    """Weighted sum of the steps up to ``half`` from the centre; None if too few are there."""
    centre = z.size // 2
    part = slice(centre - half, centre + half + 1)
    z, at_s, filled = z[part], at_s[part], filled[part]
    good = filled[1:] & filled[:-1]
    if np.mean(good) < 0.8:
        return None
    middle = (np.arange(2 * half) + 0.5) / half - 1.0
    weight = np.where(good, (1.0 - middle**2) ** 2, 0.0)
    product = z[1:] * z[:-1].conj()
    total = weight @ product
    size = np.abs(product) * weight
    dt_s = float(size @ np.diff(at_s) / size.sum())
    # Noise of the sum across its direction: of single averages, shared by neighbours, and noise
    # times noise.
    power = max(abs(total) / weight.sum() - OVERLAP * noise_z, 1e-12)
    edges = np.diff(weight, prepend=0.0, append=0.0)
    linear = edges @ edges + 2.0 * OVERLAP * (edges[1:] @ edges[:-1])
    across = 0.5 * noise_z * (power * linear + noise_z * (weight @ weight))
    noise_hz2 = across / (2.0 * np.pi * dt_s * power * weight.sum() * scale) ** 2
    # Length of the parabola that spreads over time as much as these weights and averages do.
    length_s = float(step_s * np.hypot(2.0 * half * SPREAD, HANN_SPREAD))
    smear_hz = 1e-3 * float(np.interp(length_s, SMEAR_S, SMEAR_MHZ))
    return _Step(
        float(np.angle(total) / (2.0 * np.pi * dt_s)), float(noise_hz2) + smear_hz**2, length_s
    )
