"""First part of the paper's time-of-recording verification: an ENF for every hypothesis.

Model (paper, Section IV): for every line and every idle ratio of 0, 5, … 95 % the missing rows are
interpolated; in the rows of all frames, concatenated with them, light is a tone at the line in
white noise. The matchers ``metric1`` to ``metric4`` choose between hypotheses by the reference.

Statistic: the peak of the power under a Hann window of 20 s, a value a second, by a parabola
through its logarithm. :class:`SlidingSpectrum` transforms each hop once, and takes the Hann
spectrum from the rectangular window's at three frequencies, about the window's centre ``c``:
``½·S(f) + ¼·S(f − 1/W)·e^(−j2πc/W) + ¼·S(f + 1/W)·e^(j2πc/W)``.

Approximate: interpolated rows are no samples, and the standard error knows nothing of their errors.
The texture is the mean of all frames so far; at a 0 Hz alias part of the flicker goes with it.

References
----------
Vatansever, S., Dirik, A. E. and Memon, N. (2019), Analysis of rolling shutter effect on ENF based
video forensics, IEEE TIFS 14.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.flicker.cell_light import CellLight
from rsenf.flicker.lines import alias_hz
from rsenf.flicker.slow_time import SlowTime
from rsenf.flicker.tone import Tone, decibels
from rsenf.messages import EnfEstimate, Header, RowBlock
from rsenf.track.method import TrackSettings
from rsenf.track.paper_templates import Hypothesis, PaperTemplates, hypotheses
from rsenf.track.sliding import Window
from rsenf.track.stft import DRIFT_MARGIN, SMEAR_STD_HZ, StftTracker
from rsenf.track.window import LineFit, TonePhase, apart_hz2

Complex = NDArray[np.complex128]
Float = NDArray[np.float64]

# Points of the frequency grid per 1/W, as of a transform zero-padded to four times its length.
OVERSAMPLING = 4


class SlidingSpectrum:
    """Hann spectra at exact frame times; missing frames count nothing.

    The static part of the picture, the mean of each series over all frames so far, is subtracted.
    It is at 0 Hz in slow time, where the alias of ``f_0`` is at 25 frames/s and 50 Hz: its texture
    would be the strongest line there. (The mean over the window alone would remove the flicker too,
    whose alias hardly turns within 20 s.)

    Parameters
    ----------
    carrier_hz : float
        Middle of the band.
    columns : ndarray of int, shape (series,)
        Columns of the buffer's values.
    window_s, hop_s : float
        The first a whole multiple of the second.
    search_hz : float
        Half-width of the band.
    """

    def __init__(
        self,
        carrier_hz: float,
        columns: NDArray[np.int64],
        window_s: float,
        hop_s: float,
        search_hz: float,
    ) -> None:
        self.carrier_hz, self.columns = carrier_hz, columns
        self._window_s, self._hop_s = window_s, hop_s
        step_hz = 1.0 / (OVERSAMPLING * window_s)
        half = int(np.ceil(search_hz / step_hz))
        self.offsets_hz = np.arange(-half, half + 1) * step_hz
        beyond = np.arange(-half - OVERSAMPLING, half + OVERSAMPLING + 1) * step_hz
        self._grid_hz = carrier_hz + beyond
        self.unit_var_hz2 = _unit_variance(window_s)
        # Spectra of the last hops (of the series, then of a constant), and their frame counts.
        self._hops: deque[tuple[Complex, int]] = deque(maxlen=round(window_s / hop_s))
        self._taken = 0
        self._frames = 0
        self._total = np.zeros(columns.size, np.complex128)

    def of_window(self, buffer: SlowTime, number: int) -> Complex:
        """Spectra of the window that begins with a hop, in levels, shape (offsets, series).

        Windows must be requested in order, while the buffer still has their frames.

        Parameters
        ----------
        buffer : SlowTime
        number : int
            Number of the hop.
        """
        while self._taken < number + (self._hops.maxlen or 0):
            self._take(buffer)
        whole, frames = self._hops[0]
        for spectrum, count in itertools.islice(self._hops, 1, None):
            whole, frames = whole + spectrum, frames + count
        if not frames:
            return np.zeros((self.offsets_hz.size, self.columns.size), np.complex128)
        turn = np.exp(-2j * np.pi * (number * self._hop_s / self._window_s + 0.5))
        mid, side = slice(OVERSAMPLING, -OVERSAMPLING), 2 * OVERSAMPLING
        hann = whole[mid] + 0.5 * (turn * whole[:-side] + turn.conjugate() * whole[side:])
        still = self._total / self._frames
        return np.asarray((hann[:, :-1] - hann[:, -1:] * still) / frames, np.complex128)

    def _take(self, buffer: SlowTime) -> None:
        """Transform the next hop."""
        part = buffer.between(self._taken * self._hop_s, (self._taken + 1) * self._hop_s)
        values = buffer.values(part)[:, self.columns]
        turns = np.exp(-2j * np.pi * self._grid_hz[:, None] * buffer.times(part))
        constant = np.ones((values.shape[0], 1))
        self._hops.append((turns @ np.concatenate([values, constant], axis=1), values.shape[0]))
        self._total += values.sum(axis=0)
        self._frames += values.shape[0]
        self._taken += 1


class Peaks(NamedTuple):
    """The strongest tone of each series; arrays of shape (series,).

    ``snr`` is its power over the noise power in a cell, ``one_sided`` its power over that at the
    mirrored alias.
    """

    offset_hz: Float
    offset_var_hz2: Float
    amplitude: Float
    snr: Float
    one_sided: Float
    at_edge: NDArray[np.bool_]

    def tone(self, i: int) -> Tone:
        """Return the tone of one series."""
        return Tone(
            float(self.offset_hz[i]), float(self.offset_var_hz2[i]), float(self.amplitude[i]),
            float(self.snr[i]), bool(self.at_edge[i]),
        )  # fmt: skip


def peaks(spectrum: Complex, of: SlidingSpectrum, alias_hz: float) -> Peaks:
    """Find the maximum of each spectrum, refined by quadratic interpolation of its logarithm.

    Noise power is exponentially distributed: its mean is its median over the band, over ln 2.

    Parameters
    ----------
    spectrum : ndarray of complex, shape (offsets, series)
    of : SlidingSpectrum
        Where the spectrum is from.
    alias_hz : float
        Alias of the carrier.
    """
    power = spectrum.real**2 + spectrum.imag**2
    top = np.argmax(power, axis=0)
    at_edge = (top == 0) | (top == len(power) - 1)
    series = np.arange(power.shape[1])
    middle = np.clip(top, 1, len(power) - 2)
    a, b, c = (
        np.log(np.maximum(power[middle + i, series], np.finfo(float).tiny)) for i in (-1, 0, 1)
    )
    bend = np.where(at_edge, 0.0, a - 2.0 * b + c)
    shift = np.divide(0.5 * (a - c), bend, out=np.zeros_like(bend), where=bend < 0.0)
    height = np.where(bend < 0.0, np.exp(b - 0.25 * (a - c) * shift), power[top, series])
    step_hz = of.offsets_hz[1] - of.offsets_hz[0]
    offset_hz = of.offsets_hz[top] + shift * step_hz
    snr = _ratio(height, np.median(power, axis=0) / np.log(2.0))
    mirror = np.rint((-2.0 * alias_hz - offset_hz - of.offsets_hz[0]) / step_hz).astype(np.int64)
    seen = (mirror >= 0) & (mirror < len(power))
    other = np.where(seen, power[np.where(seen, mirror, 0), series], 0.0)
    variance = np.divide(of.unit_var_hz2, snr, out=np.full_like(snr, np.inf), where=snr > 0.0)
    return Peaks(offset_hz, variance, np.sqrt(height), snr, _ratio(height, other), at_edge)


def _ratio(power: Float, over: Float) -> Float:
    """Ratio of powers: infinite over 0, but 0 if both are 0."""
    nothing = np.where(power > 0.0, np.inf, 0.0)
    return np.divide(power, over, out=nothing, where=over > 0.0)


def _unit_variance(window_s: float) -> float:
    """Variance of a frequency (Hz²) for unit signal-to-noise power in a cell, of a full window.

    As in :class:`rsenf.flicker.tone.ToneFinder`, in the limit of many frames.
    """
    t = (np.arange(1000) + 0.5) / 1000 - 0.5
    w = np.cos(np.pi * t) ** 2
    w /= w.sum()
    spread = (w**2 @ t**2) / (w @ t**2) ** 2 / (w @ w)
    return float(spread) / (2.0 * np.pi * window_s) ** 2 / 2.0


UPWARD = (
    "the flicker runs up the rows, and what shows on the paper's lines may be its second harmonic"
)


class PaperTracker(StftTracker):
    """Estimates of each window: one per hypothesis, ``rank`` 1, 2, … in a fixed order; then rank 0.

    A hypothesis is no claim, so its value is usable wherever the window has its frames. Rank 0 is
    the tracker's own claim: the hypothesis of the highest signal-to-noise ratio so far, judged as
    the sliding STFT is. (Not one at ``2·f_0``: where that is a line of the first harmonic too, it
    isn't known which of the two was seen.) Without a nominal frequency both grids' hypotheses are
    published.

    Raises
    ------
    UsageError
        If the window isn't a whole number of hops.
    """

    name = "paper"
    help = "tries every line with every idle ratio, for the paper's metrics to choose from"
    obeys = frozenset({"interpolation"})

    def __init__(self, settings: TrackSettings | None = None) -> None:
        super().__init__(settings)
        s = self.settings
        hops = s.window_s / s.hop_s
        if abs(hops - round(hops)) > 1e-9:
            raise UsageError(
                f"a window of {s.window_s:g} s isn't a whole number of hops of {s.hop_s:g} s"
            )
        self._hypotheses: tuple[Hypothesis, ...] = ()
        self._spectra: list[SlidingSpectrum] = []
        self._sent = 0
        # SNR of each hypothesis in dB, summed over the windows so far.
        self._best = 0  # number of the largest
        self._standing_db: NDArray[np.float64] = np.zeros(0)

    def _prepare(self, first: RowBlock, frame_rate_hz: float) -> int:
        s = self.settings
        if first.rows > 1:
            self._hypotheses = tuple(
                h
                for n in s.nominals_hz
                for h in hypotheses(n, frame_rate_hz, self._finder.search_hz)
            )
        harmonic = np.array([h.line.harmonic for h in self._hypotheses])
        self._standing_db = np.where(harmonic == 1, 0.0, -np.inf)
        self._templates = PaperTemplates(
            self._hypotheses, frame_rate_hz, first.rows, s.interpolation
        )
        carriers = np.array([h.line.carrier_hz for h in self._hypotheses])
        for line in {h.line.carrier_hz: h.line for h in self._hypotheses}.values():
            columns = np.flatnonzero(carriers == line.carrier_hz)
            search_hz = 2.0 * s.search_hz * line.harmonic
            self._spectra.append(
                SlidingSpectrum(line.carrier_hz, columns, s.window_s, s.hop_s, search_hz)
            )
        return len(self._hypotheses)

    def _tone_series(self, window: Window, found: EnfEstimate) -> Complex:
        return np.asarray(window.buffer.values(window.part)[:, self._best], np.complex128)

    def _reduce(self, block: RowBlock) -> Complex:
        return self._templates.reduce(block)

    def _estimates(self, window: Window) -> list[EnfEstimate]:
        # Requested even if unused: the spectra need every hop in order.
        spectra = [one.of_window(window.buffer, self._hops) for one in self._spectra]
        blank, reason = self._blank(window), self._what_lacks(window)
        if not self._hypotheses:
            reason = reason or "one mean per frame: no rows to interpolate between"
        out = (
            [dataclasses.replace(blank, header=blank.header.numbered(self._sent), reason=reason)]
            if reason
            else self._judge_all(window, blank, spectra)
        )
        self._sent += len(out)
        return out

    def _why_not_mains(
        self, window: Window, found: EnfEstimate, course: TonePhase, light: CellLight | None
    ) -> str:
        """Return why it isn't mains light, such as a read-out upward; '' if it may be.

        The paper's lines are those of a read-out downward. Light that is read upward shows little
        on them, and the image of its second harmonic instead.
        """
        image_hz = alias_hz(6.0 * found.nominal_hz, found.frame_rate_hz)
        if light and light.turns < 0.0 and abs(image_hz) < self._finder.search_hz:
            return UPWARD
        return super()._why_not_mains(window, found, course, light)

    def _judge_all(
        self, window: Window, blank: EnfEstimate, spectra: list[Complex]
    ) -> list[EnfEstimate]:
        """Return the estimates of all hypotheses, then the tracker's own."""
        rate_hz = blank.frame_rate_hz
        found = Peaks(*(np.zeros(len(self._hypotheses), dtype) for dtype in "ddddd?"))
        for one, spectrum in zip(self._spectra, spectra, strict=True):
            part = peaks(spectrum, one, alias_hz(one.carrier_hz, rate_hz))
            for whole, values in zip(found, part, strict=True):
                whole[one.columns] = values
        out = [
            _fill_in(blank, blank.header.numbered(self._sent + i), h, found, i)
            for i, h in enumerate(self._hypotheses)
        ]
        margin = [
            DRIFT_MARGIN if self._near_zero(h.line, rate_hz) else 1.0 for h in self._hypotheses
        ]
        self._standing_db += 10.0 * np.log10(np.maximum(found.snr, 1e-30) / margin)
        best = self._best = int(np.argmax(self._standing_db))
        fit = LineFit(
            self._hypotheses[best].line, found.tone(best), 0.0, 0.0, float(found.one_sided[best])
        )
        reason = self._why_unusable(fit, rate_hz)
        chosen = self._hypotheses[best]
        ramps = [
            i
            for i, h in enumerate(self._hypotheses)
            if h.line.carrier_hz == chosen.line.carrier_hz and h.idle_ratio == chosen.idle_ratio
        ]
        apart2 = (
            apart_hz2(
                window.buffer.values(window.part)[:, ramps],
                ramps.index(best),
                window.buffer.times(window.part) - window.centre_s,
                fit.line.carrier_hz + fit.tone.offset_hz,
                self.settings.window_s,
            )
            / (2.0 * fit.line.harmonic) ** 2
        )
        header = blank.header.numbered(self._sent + len(out))
        claim = (
            dataclasses.replace(blank, header=header, snr_db=out[best].snr_db, reason=reason)
            if reason
            else dataclasses.replace(
                out[best], header=header, rank=0, enf_var_hz2=out[best].enf_var_hz2 + apart2
            )
        )
        return [*out, self._believed(window, blank, claim)]


def _fill_in(
    blank: EnfEstimate, header: Header, hypothesis: Hypothesis, found: Peaks, i: int
) -> EnfEstimate:
    """Fill in the result under hypothesis number ``i``, counted from 0."""
    line = hypothesis.line
    scale = 2.0 * line.harmonic
    snr = float(found.snr[i])
    return dataclasses.replace(
        blank,
        header=header,
        rank=i + 1,
        nominal_hz=line.nominal_hz,
        harmonic=line.harmonic,
        line_m=line.m,
        line_hz=abs(line.line_hz(blank.frame_rate_hz)),
        idle_ratio=hypothesis.idle_ratio,
        enf_hz=line.nominal_hz + float(found.offset_hz[i]) / scale,
        enf_var_hz2=float(found.offset_var_hz2[i]) / scale**2 + SMEAR_STD_HZ**2,
        snr_db=decibels(snr),
        usable=snr > 0.0,
        reason="" if snr > 0.0 else "nothing at this line",
    )
