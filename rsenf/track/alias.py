"""Methods of earlier publications, which read the illumination frequency itself or its alias.

*Frame means* (Garg 2011): all steady pixels of a frame are averaged. Under a rolling shutter the
rows' phases differ, and most of the flicker averages out. *Concatenated rows* (Su 2014): the row
means of one frame follow those of the frame before without a gap, and the spectrum is read at
``k·f_0``. What the idle period moves to other lines ``k·f_0 + m·F_r`` (paper, Eq. 21) is lost: at
29.97 fps, 100 Hz and 30 % idle the line at ``f_0`` vanishes. *Superpixels* (Vatansever 2017):
regions of even brightness, here tiles, else bands of rows in each strip, are averaged.

Model: as in :mod:`rsenf.track.stft`, a constant, a tone and white noise. One value a frame shows
the tone at the alias ``k·f_0 − n·F_r`` only. Regions share its frequency, not phase or amplitude.

Statistic: the floating-mean periodogram; over regions its sum ``Σ_r P_r(f) / N_r``, which is their
log-likelihood if ``N_r`` is a region's noise power. Regions ten times noisier than the median one
aren't steady, and left out. Agreement is the rarity of the sum's peak by Chernoff's bound.

Approximate: the number of independent regions is estimated from the sum's scatter beside the peak.
Near 0 Hz and half the frame rate the sign of the deviation is unknown, and there is no estimate.

References
----------
- Garg, R., Varna, A. L. and Wu, M. (2011), "Seeing" ENF: natural time stamp for digital video via
  optical sensing and signal processing, ACM Multimedia.
- Su, H., Hajj-Ahmad, A., Garg, R. and Wu, M. (2014), Exploiting rolling shutter for ENF signal
  extraction from video, ICIP.
- Vatansever, S., Dirik, A. E. and Memon, N. (2017), Detecting the presence of ENF signal in digital
  videos: a superpixel-based approach, IEEE Signal Processing Letters 24(10).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.flicker.acquire import NO_FLICKER
from rsenf.flicker.lines import Line
from rsenf.flicker.mains import FAINT
from rsenf.flicker.tone import AT_EDGE, NOISE_CELLS, OVERSAMPLING, ToneFinder, decibels
from rsenf.messages import EnfEstimate, RowBlock
from rsenf.track.method import TrackSettings
from rsenf.track.sliding import MIN_AMPLITUDE_LEVEL, SlidingTracker, Window
from rsenf.track.stft import SMEAR_STD_HZ, StftTracker
from rsenf.track.window import LineFit


def check_line(settings: TrackSettings, method: str) -> None:
    """Refuse settings that ask for another line than the harmonic's own.

    Parameters
    ----------
    settings : TrackSettings
    method : str
        Name of the method, for the message.

    Raises
    ------
    UsageError
        If they do.
    """
    if settings.line_m not in (None, 0):
        raise UsageError(
            f"{method} reads the illumination frequency itself, not line {settings.line_m}",
            "leave the line out, or take another method",
        )


def is_folded(line: Line, frame_rate_hz: float, search_hz: float) -> bool:
    """Whether the search band overlaps its own mirror image.

    One real value a frame has the same spectrum on both sides of 0 Hz and of half the frame rate,
    so that near them the sign of the deviation is unknown.

    Parameters
    ----------
    line : Line
    frame_rate_hz : float
    search_hz : float
        Half-width of the search band.

    Examples
    --------
    >>> is_folded(Line(50.0, 1, 0), 25.0, 1.0), is_folded(Line(50.0, 1, 0), 29.97, 1.0)
    (True, False)
    """
    twice_hz = 2.0 * line.carrier_hz
    apart_hz = abs(twice_hz - frame_rate_hz * round(twice_hz / frame_rate_hz))
    return apart_hz <= 2.0 * search_hz


def why_nothing(lines: Sequence[Line], frame_rate_hz: float, search_hz: float) -> str:
    """Return why nothing was found at the aliases of some lines, which may be folded.

    Parameters
    ----------
    lines : sequence of Line
    frame_rate_hz : float
    search_hz : float
        Half-width of the search band.
    """
    grids = [f"{x.nominal_hz:.0f}" for x in lines if is_folded(x, frame_rate_hz, search_hz)]
    if not grids:
        return NO_FLICKER
    alias_hz = min(abs(x.alias_hz(frame_rate_hz)) for x in lines)
    where = "0 Hz" if alias_hz <= search_hz else "half the frame rate"
    blind = (
        f"flicker of a {' or '.join(grids)} Hz grid shows too near {where} at "
        f"{frame_rate_hz:.3f} frames/s for one value a frame"
    )
    return blind if len(grids) == len(lines) else f"{NO_FLICKER}; {blind}"


class FrameMeanTracker(StftTracker):
    """Frame means at the alias. Takes blocks of rows, or of one mean per frame.

    No estimate where the alias is near 0 Hz or half the frame rate.

    Raises
    ------
    UsageError
        If the settings name a line.
    """

    name = "frame_mean"
    help = "reads one mean per frame at the alias (Garg 2011)"

    def __init__(self, settings: TrackSettings | None = None) -> None:
        super().__init__(settings)
        check_line(self.settings, self.name)

    def _candidates(self, nominal_hz: float, frame_rate_hz: float, rows: int) -> tuple[Line, ...]:
        return super()._candidates(nominal_hz, frame_rate_hz, 1)

    def _prepare(self, first: RowBlock, frame_rate_hz: float) -> int:
        return super()._prepare(_frame_means(first), frame_rate_hz)

    def _reduce(self, block: RowBlock) -> NDArray[np.complex128]:
        return super()._reduce(_frame_means(block))

    def _is_faint(self, amplitude: float, line: Line, offset_hz: float) -> bool:
        """Never: the rows' phases average out, so that the rest says nothing of the light."""
        return False

    def _why_unusable(self, fit: LineFit, rate_hz: float) -> str:
        if is_folded(fit.line, rate_hz, self._finder.search_hz):
            return why_nothing((fit.line,), rate_hz, self._finder.search_hz)
        return super()._why_unusable(fit, rate_hz)

    def _judge(self, window: Window, blank: EnfEstimate) -> EnfEstimate:
        found = super()._judge(window, blank)
        if found.reason != NO_FLICKER:
            return found
        why = why_nothing(self._lines, window.frame_rate_hz, self._finder.search_hz)
        return dataclasses.replace(found, reason=why)


def _frame_means(block: RowBlock) -> RowBlock:
    """Average the rows and strips of a block; unsteady places count as their background."""
    if block.frames == 0:
        return block
    mean = block.level.mean(axis=(1, 2), dtype=np.float64)
    return dataclasses.replace(
        block,
        read_out_axis="frame",
        rows=1,
        strips=1,
        level=mean.astype(np.float32)[:, None, None],
        kept_px=np.array([[block.kept_px.sum()]], np.uint32),
    )


class RowConcatTracker(StftTracker):
    """The sliding STFT at ``f_0``, even if another line is stronger. Needs rows.

    Raises
    ------
    UsageError
        If the settings name another line.
    """

    name = "row_concat"
    help = "reads the rows of all frames, concatenated without idle period (Su 2014)"

    def __init__(self, settings: TrackSettings | None = None) -> None:
        super().__init__(settings)
        check_line(self.settings, self.name)

    def _candidates(self, nominal_hz: float, frame_rate_hz: float, rows: int) -> tuple[Line, ...]:
        return (Line(nominal_hz, self.settings.harmonic, 0),)

    def _judge(self, window: Window, blank: EnfEstimate) -> EnfEstimate:
        if self._rows == 1:
            return dataclasses.replace(blank, reason="one mean per frame: no rows to concatenate")
        return super()._judge(window, blank)


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
        self._lines = tuple(Line(n, s.harmonic, 0) for n in s.nominals_hz)
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
