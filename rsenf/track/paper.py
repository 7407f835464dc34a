"""First part of the paper's time-of-recording verification: an ENF for every hypothesis.

Paper, Section V: for every line and every idle ratio of 0, 5, … 95 % the missing rows are
interpolated, the rows of all frames are concatenated with them, and a sliding STFT (20 s windows, a
value a second, quadratic interpolation of the peak) reads the ENF at the line. The choice between
hypotheses is left to the matchers ``metric1`` to ``metric4``, which compare all of them with the
reference.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.flicker.cell_light import Light
from rsenf.flicker.lines import alias_hz
from rsenf.messages import EnfEstimate, Header, RowBlock
from rsenf.track.course import Course, apart_hz2
from rsenf.track.paper_hypotheses import Hypothesis, hypotheses
from rsenf.track.paper_spectrum import Complex, Peaks, SlidingSpectrum, peaks
from rsenf.track.paper_templates import PaperTemplates
from rsenf.track.settings import TrackSettings
from rsenf.track.sliding import Window, decibels
from rsenf.track.stft import DRIFT_MARGIN, SMEAR_STD_HZ, StftTracker
from rsenf.track.window import LineFit

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
        nominals = (s.nominal_hz,) if s.nominal_hz else (50.0, 60.0)
        if first.rows > 1:
            self._hypotheses = tuple(
                h for n in nominals for h in hypotheses(n, frame_rate_hz, self._finder.search_hz)
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

    def _why_not_mains(self, found: EnfEstimate, course: Course, light: Light | None) -> str:
        """Return why it isn't mains light, such as a read-out upward; '' if it may be.

        The paper's lines are those of a read-out downward. Light that is read upward shows little
        on them, and the image of its second harmonic instead.
        """
        image_hz = alias_hz(6.0 * found.nominal_hz, found.frame_rate_hz)
        if light and light.turns < 0.0 and abs(image_hz) < self._finder.search_hz:
            return UPWARD
        return super()._why_not_mains(found, course, light)

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
