"""Where model and data disagree: the gap split by time, row, level, strip and frequency.

Every share is a mean of products of neighbours, as the gap is, so noise doesn't bias it. A tone of
constant frequency in the residual is found with the frequencies it may be an alias of.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.measured import BANDS, LINES, STRIPS
from rsenf.discrepancy.residual_features import features_of
from rsenf.messages.schema import FloatArray

LEVELS = 4
PEAKS = 6  # largest number of spectral lines
NEAR = 2  # half width of a spectral line, in bins
HIGHEST_HZ = 3000.0  # of lamp drivers' flicker that row means can show
HARMONICS = 4  # harmonics of the flicker whose lines are excluded
NEAR_HZ = 0.15  # tolerance of a line's frequency, beyond the grid's wander
MOST = 0.5  # least share of the residual of a tone and its sidebands about the flicker


@dataclass(frozen=True)
class ResidualShare:
    """A part of the gap."""

    axis: str  # ``time_s``, ``row``, ``level``, ``strip``, ``step`` or ``alias_hz``
    low: float  # interval on the axis
    high: float
    # part of the whole gap. The parts of one axis add up to 1, except ``step`` and ``alias_hz``
    share: float
    # the part over its standard error; for a spectral line over the noise of the spectrum
    sure: float


def where(fit: Fit) -> list[ResidualShare]:
    """Split the held-out gap of a fit along each axis."""
    data, held = fit.data, ~fit.data.training
    first, second = data.halves(fit.residual[held])
    product = (first * second).astype(np.float64)  # (frames, lines, strips), one axis in pairs
    wall = data.halves(fit.forward.wall[None])[0][0]
    lines, strips = np.arange(product.shape[1]), np.arange(product.shape[2])
    by_line, by_strip = data.every(LINES) * data.group, data.every(STRIPS)
    out = [
        *_by_time(fit, product, held),
        *_parts("row", product, 1, np.array_split(lines, BANDS), by_line),
        *_by_level(product, wall),
    ]
    if strips.size > 1:
        out += _parts("strip", product, 2, np.array_split(strips, strips.size), by_strip)
    return [*out, _by_step(fit), *_by_alias(fit)]


def _parts(
    axis: str, product: FloatArray, along: int, groups: list[np.ndarray], every: int
) -> Iterator[ResidualShare]:
    """Share of each group of indices along an axis of the products."""
    total = float(product.sum())
    for group in groups:
        in_group = np.take(product, group, axis=along).sum(axis=(1, 2))
        yield _share(axis, every * int(group[0]), every * (int(group[-1]) + 1), in_group, total)


def _by_time(fit: Fit, product: FloatArray, held: np.ndarray) -> Iterator[ResidualShare]:
    time_s, block = fit.data.time_s[held], fit.data.block[held]
    total, by_frame = float(product.sum()), product.sum(axis=(1, 2))
    for number in np.unique(block):
        in_block = block == number
        yield _share("time_s", time_s[in_block][0], time_s[in_block][-1], by_frame[in_block], total)


def _by_level(product: FloatArray, wall: FloatArray) -> Iterator[ResidualShare]:
    total = float(product.sum())
    edges = np.unique(np.quantile(wall, np.linspace(0.0, 1.0, LEVELS + 1)))  # some may be equal
    for low, high in pairwise(edges if edges.size > 1 else edges.repeat(2)):
        in_band = (wall >= low) & ((wall < high) | (high == edges[-1]))
        yield _share("level", low, high, product[:, in_band].sum(axis=1), total)


def _by_step(fit: Fit) -> ResidualShare:
    """Share of the frame-to-frame changes; 1 for a residual that is white in time."""
    first, second = fit.data.halves(fit.residual)
    steps = (np.diff(first, axis=0) * np.diff(second, axis=0)).sum(axis=(1, 2))
    total = 2.0 * float((first * second).sum(dtype=np.float64))
    return _share("step", 1.0, 1.0, steps.astype(np.float64), total)


def alias_spectrum(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Return the cross-spectrum of neighbouring lines over frames, averaged over the lines.

    Returns
    -------
    freq_hz : ndarray (bins,)
    power : ndarray (bins,)
        Systematic power of the residual relative to the flicker's. The bins add up to the gap of
        all frames.
    """
    frames = fit.data.frames
    first, second = (np.fft.rfft(half, axis=0) for half in fit.data.halves(fit.residual))
    power = (first * second.conj()).real.mean(axis=(1, 2), dtype=np.float64)
    power[1 : (frames + 1) // 2] *= 2.0  # one-sided spectrum
    flicker = float((fit.flicker**2).mean(dtype=np.float64)) or 1e-30
    freq_hz = np.fft.rfftfreq(frames, 1.0 / float(fit.data.frame_rate))
    return np.asarray(freq_hz, np.float64), np.asarray(power / (float(frames) ** 2 * flicker))


def _by_alias(fit: Fit) -> Iterator[ResidualShare]:
    """Spectral lines that stand out of :func:`alias_spectrum`."""
    hz, power = alias_spectrum(fit)
    total, noise = float(power.sum()), 1.4826 * float(np.median(np.abs(power))) + 1e-30
    for _ in range(PEAKS):
        peak = int(np.argmax(power))
        low, high = max(peak - NEAR, 0), min(peak + NEAR, power.size - 1)
        band = float(power[low : high + 1].sum())
        if power[peak] < 5.0 * noise:
            return
        yield ResidualShare("alias_hz", hz[low], hz[high], band / total, float(power[peak] / noise))
        power[low : high + 1] = 0.0


def _share(axis: str, low: float, high: float, products: FloatArray, total: float) -> ResidualShare:
    error = float(products.std() * math.sqrt(products.size))
    total, summed = total or 1e-30, float(products.sum())
    return ResidualShare(axis, float(low), float(high), summed / total, summed / max(error, 1e-30))


@dataclass(frozen=True)
class Alias:
    """A tone of constant frequency, of which the frames show an alias."""

    alias_hz: float
    # frequencies of light that agree with the phase ramp down the lines, the likeliest first
    likely_hz: tuple[float, ...]
    may_be_hz: tuple[float, ...]  # all frequencies with this alias, rising


def tone_of(last: Fit, lines: Sequence[ResidualShare]) -> Alias | None:
    """Find a tone that isn't the flicker's and that, with its sidebands, is most of the residual.

    Parameters
    ----------
    last : Fit
    lines : sequence of ResidualShare
        Spectral lines of its residual.
    """
    rate_hz = float(last.data.frame_rate)
    expected_hz = [(0.0, NEAR_HZ), *flicker_hz(last, range(1, HARMONICS + 1))]
    strange = [line for line in lines if not is_at(line, expected_hz)]
    if not strange:
        return None
    strongest = max(strange, key=lambda line: line.share)
    alias_hz = (strongest.low + strongest.high) / 2.0
    ((first_hz, width_hz),) = flicker_hz(last, range(1, 2))
    sides = [(abs(math.remainder(first_hz + s * alias_hz, rate_hz)), width_hz) for s in (-1, 1)]
    # Includes the skirts of the line itself.
    equivalents = [(alias_hz, 2.0 * NEAR_HZ), *sides]
    if sum(line.share for line in strange if is_at(line, equivalents)) < MOST:
        return None
    folded = {hz: abs(math.remainder(hz, rate_hz)) for hz in features_of(last).tones_hz}
    likely = [hz for hz, of_hz in folded.items() if abs(of_hz - alias_hz) < NEAR_HZ]
    if likely:
        alias_hz = folded[likely[0]]
    turns = np.arange(-round(HIGHEST_HZ / rate_hz), round(HIGHEST_HZ / rate_hz) + 1)
    may_be = np.unique(np.round(np.abs(alias_hz + turns * rate_hz), 3))
    may_be = may_be[may_be <= HIGHEST_HZ]
    return Alias(round(alias_hz, 3), tuple(round(hz, 3) for hz in likely), tuple(may_be.tolist()))


def flicker_hz(last: Fit, harmonics: range) -> list[tuple[float, float]]:
    """Alias of each harmonic of the flicker, and half the width of its line (Hz)."""
    freq_hz = 2.0 * last.forward.course.grid().freq_hz
    mean_hz, width_hz = float(freq_hz.mean()), float(np.ptp(freq_hz))
    rate_hz = float(last.data.frame_rate)
    return [(abs(math.remainder(k * mean_hz, rate_hz)), NEAR_HZ + k * width_hz) for k in harmonics]


def is_at(line: ResidualShare, places: Sequence[tuple[float, float]]) -> bool:
    """Return whether a spectral line is at one of several places (frequency and tolerance, Hz)."""
    middle_hz = (line.low + line.high) / 2.0
    return any(abs(middle_hz - place_hz) < near_hz for place_hz, near_hz in places)
