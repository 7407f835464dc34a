"""ENF from many regions of the picture, each a series of one value a frame.

S. Vatansever, A. E. Dirik, N. Memon, "Detecting the presence of ENF signal in digital videos: a
superpixel-based approach", IEEE Signal Processing Letters 24(10), 2017. There the picture is cut
into regions of even brightness (SLIC superpixels); the steady ones are averaged in each frame, each
gives an estimate at the alias, and mains flicker is present if the estimates agree. Within a small
region a rolling shutter's rows hardly differ in phase, so less averages out than in the mean of a
whole frame.

Here the regions are the tiles of the blocks if they have any, else bands of rows in each strip.
Their phases depend on their place, so spectra are combined rather than series: the sum of each
region's floating-mean periodogram over its own noise power. That is the log-likelihood of one
frequency common to all regions, with a free phase and amplitude in each. A region that moves has
much noise and so little weight; one far noisier than the median region isn't steady, and left out.
Agreement is tested on the sum: noise that is independent between regions hardly fluctuates in it,
so a common peak stands out the more regions there are; how independent they are is measured beside
the peak.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import Line
from rsenf.flicker.mains import FAINT
from rsenf.flicker.tone import AT_EDGE, NOISE_CELLS, OVERSAMPLING, ToneFinder
from rsenf.messages import EnfEstimate, RowBlock
from rsenf.track.alias import check_line, is_folded, why_nothing
from rsenf.track.settings import TrackSettings
from rsenf.track.sliding import (
    MIN_AMPLITUDE_LEVEL,
    NO_FLICKER,
    SlidingTracker,
    Window,
    decibels,
)
from rsenf.track.stft import SMEAR_STD_HZ

Float = NDArray[np.float64]

# Bands of rows if the blocks have no tiles. Four turns of phase down the rows are the most at 24
# frames/s; a band then holds a sixth of a turn, which costs 5 % of the amplitude.
BANDS = 24
# Most noise power of a steady region, relative to the median region's.
STEADY_RATIO = 10.0


@dataclasses.dataclass(frozen=True)
class _Peak:
    """Peak of the summed spectrum; ``rarity`` is ``−ln`` of its probability in noise alone."""

    line: Line
    offset_hz: float
    offset_var_hz2: float
    snr: float
    rarity: float
    level: float
    at_edge: bool


class SuperpixelTracker(SlidingTracker):
    """Weighted sum of the regions' spectra at the alias. Takes rows, tiles or frame means.

    Raises
    ------
    UsageError
        If the settings name a line.
    """

    name = "superpixel"
    help = "reads many regions of the picture at the alias, together (Vatansever 2017)"
    rows_needed: ClassVar[Mapping[str, Any]] = {"tile_means": True}

    def __init__(self, settings: TrackSettings | None = None) -> None:
        super().__init__(settings)
        s = self.settings
        check_line(s, self.name)
        self._finder = ToneFinder(s.window_s, 2.0 * s.search_hz * s.harmonic)
        nominals = (s.nominal_hz,) if s.nominal_hz else (50.0, 60.0)
        self._lines = tuple(Line(n, s.harmonic, 0) for n in nominals)
        self._shape: tuple[int, ...] = ()

    def _prepare(self, first: RowBlock, frame_rate_hz: float) -> int:
        self._shape = _regions(first).shape[1:]
        return int(np.prod(self._shape))

    def _fits(self, block: RowBlock) -> bool:
        return super()._fits(block) and _regions(block).shape[1:] == self._shape

    def _reduce(self, block: RowBlock) -> NDArray[np.complex128]:
        return _regions(block).reshape(block.frames, -1).astype(np.complex128)

    def _cells_of(self, block: RowBlock) -> Float:
        return _regions(block)

    def _judge(self, window: Window, blank: EnfEstimate) -> EnfEstimate:
        rate_hz, search_hz = window.frame_rate_hz, self._finder.search_hz
        peaks = [
            self._peak(window, line)
            for line in self._lines
            if not is_folded(line, rate_hz, search_hz)
        ]
        best = max(peaks, key=lambda p: p.rarity, default=None)
        if best is None:
            return dataclasses.replace(blank, reason=why_nothing(self._lines, rate_hz, search_hz))
        reason = self._why_unusable(best)
        if reason == NO_FLICKER:
            reason = why_nothing(self._lines, rate_hz, search_hz)
        if reason:
            return dataclasses.replace(blank, snr_db=decibels(best.snr), reason=reason)
        self._lines = (best.line,)
        scale = 2.0 * best.line.harmonic
        return dataclasses.replace(
            blank,
            nominal_hz=best.line.nominal_hz,
            line_hz=best.line.carrier_hz,
            enf_hz=best.line.nominal_hz + best.offset_hz / scale,
            enf_var_hz2=best.offset_var_hz2 / scale**2 + SMEAR_STD_HZ**2,
            snr_db=decibels(best.snr),
            usable=True,
        )

    def _tone_series(self, window: Window, found: EnfEstimate) -> NDArray[np.complex128]:
        """Sum of all regions, each times the conjugate of the tone's amplitude in it."""
        part = window.part
        t_s, seen = window.buffer.times(part), window.buffer.values(part)
        weights = self._finder.window(t_s - window.centre_s)
        seen = seen - weights @ seen
        turning = np.exp(-4j * np.pi * found.enf_hz * found.harmonic * t_s)
        return np.asarray(seen @ ((weights * turning) @ seen).conj(), np.complex128)

    def _peak(self, window: Window, line: Line) -> _Peak:
        """Sum the regions' spectra near a line's alias, and find their common peak."""
        t_s = window.buffer.times(window.part)
        carrier = np.exp(-2j * np.pi * line.carrier_hz * t_s)
        series = window.buffer.values(window.part) * carrier[:, None]
        t_s = t_s - window.centre_s
        _, power = self._finder.periodograms(series, carrier, t_s)
        noise = np.median(power, axis=0) / np.log(2.0)
        steady = (noise > 0) & (noise <= STEADY_RATIO * np.median(noise))
        if not steady.any():
            return _Peak(line, 0.0, np.inf, 0.0, 0.0, 0.0, at_edge=False)
        spectrum = np.mean(power[:, steady] / noise[steady], axis=1)
        tone = self._finder.strongest(spectrum, t_s)
        over, regions = _contrast(spectrum)
        snr = regions * (over - 1.0)
        # The tone's variance, rescaled from its own SNR to this one.
        var_hz2 = tone.offset_var_hz2 * tone.snr / snr if snr > 0 else np.inf
        level = np.sqrt(power[np.argmax(spectrum), steady].max())
        # Chernoff's bound for a sum of exponentially distributed powers.
        rarity = regions * (over - 1.0 - np.log(over)) if over > 1.0 else 0.0
        return _Peak(line, tone.offset_hz, var_hz2, snr, rarity, float(level), tone.at_edge)

    def _why_unusable(self, peak: _Peak) -> str:
        s = self.settings
        if peak.level < MIN_AMPLITUDE_LEVEL or peak.rarity < s.min_snr:
            return NO_FLICKER
        if self._is_faint(peak.level, peak.line, peak.offset_hz):
            return FAINT
        if peak.at_edge:
            return AT_EDGE
        if peak.offset_var_hz2 > (s.max_std_hz * 2.0 * s.harmonic) ** 2:
            return "too uncertain"
        return ""


def _contrast(spectrum: Float) -> tuple[float, float]:
    """Peak over the noise beside it, and the effective number of independent regions.

    The mean of ``n`` exponentially distributed powers has ``n`` times less variance than one.
    """
    peak = int(np.argmax(spectrum))
    away = np.abs(np.arange(spectrum.size) - peak)
    near = spectrum[(away > 2 * OVERSAMPLING) & (away <= NOISE_CELLS * OVERSAMPLING)]
    mean, std = float(near.mean()), float(near.std())
    return float(spectrum[peak]) / mean, max((mean / std) ** 2, 1.0) if std > 0 else 1.0


def _regions(block: RowBlock) -> Float:
    """Brightness of each region in each frame, shape (frames, bands, tiles or strips)."""
    if block.tiles:
        return np.asarray(block.tile_level, np.float64)
    starts = np.arange(min(BANDS, block.rows)) * block.rows // min(BANDS, block.rows)
    sizes = np.diff(np.append(starts, block.rows))
    sums = np.add.reduceat(block.level, starts, axis=1, dtype=np.float64)
    return np.asarray(sums / sizes[:, None], np.float64)
