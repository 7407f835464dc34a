"""Detects mains flicker: along which axis it is read out, which grid, which ramp, which frequency.

Model: the rows projected onto a ramp of phase turns are a constant, a tone near the alias of
``2·nominal`` and white noise (:func:`acquire`). Along the read-out axis flicker is a phase ramp
(:mod:`rsenf.flicker.lines`); across it every line averages the same mixture of phases: flicker may
show, but with one phase everywhere (:func:`find_axis`).

Statistic: the floating-mean periodogram (:mod:`rsenf.flicker.tone`) for each nominal frequency and
number of turns; a tone's power over the noise in a cell must exceed ``40 + (δ / 0.1 Hz)²/2``, the
log odds of exponentially distributed noise and a Gaussian prior of its offset ``δ``. Of the tones
above it the one of largest amplitude is taken: overtones, and leakage into ramps with little noise,
may have a higher signal-to-noise ratio. Its drift over the window is searched last. For the axis
the part common to all lines is subtracted, and the ramp must be stronger than the one that turns
the other way: a standing pattern of varying brightness is equally strong on both.

Approximate: noise is white near the tone, ramps are straight. Where the frame rate divides the
flicker's frequency both ways look alike; there only the power along the two axes is compared.

References
----------
- Zechmeister, M. and Kürster, M. (2009), The generalised Lomb-Scargle periodogram, A&A 496, 577.
- Kay, S. M. (1998), Fundamentals of Statistical Signal Processing, vol. II: Detection Theory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import NODE_S
from rsenf.flicker.lines import Line, ProfileBasis, alias_hz
from rsenf.flicker.tone import AT_EDGE, Tone, ToneFinder
from rsenf.flicker.zero_alias import MIN_ROWS
from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

SEARCH_HZ = 1.0  # half-width of the search band, illumination frequency
MIN_SNR = 40.0
LIKELY_HZ = 0.1  # prior standard deviation of the illumination frequency
TIED_HZ = 0.05  # mirror images whose distances from the nominal differ by less are tied
TURNS_STEP = 0.25
NO_FLICKER = "no mains flicker stands out"
# Drifts of the illumination frequency that are tried, Hz/s: grids reach 3e-3 now and then.
DRIFTS_HZ_S = np.arange(-4, 5) * 1.5e-3
NEAR_HZ = 0.1  # drifts are tried for offsets this near to the peak


@dataclass(frozen=True, eq=False)
class AcquiredFlicker:
    """Flicker detected in a window.

    Attributes
    ----------
    nominal_hz : float
    turns : float
        Phase turns of the first harmonic down the rows.
    tone : Tone
    psi_rad : ndarray, shape (nodes,)
        Phase relative to the nominal frequency's, at nodes ``NODE_S`` apart from the window's
        start.
    """

    nominal_hz: float
    turns: float
    tone: Tone
    psi_rad: Float


def acquire(
    nominals_hz: tuple[float, ...],
    basis: ProfileBasis,
    t_s: Float,
    columns: Float,
    frame_rate_hz: float,
    span_s: tuple[int, int],
    min_snr: float = MIN_SNR,
) -> AcquiredFlicker | str:
    """Detect flicker in a window; return the reason in words if there is none.

    Parameters
    ----------
    nominals_hz : tuple of float
        Nominal grid frequencies to look for.
    basis : ProfileBasis
    t_s : ndarray, shape (frames,)
        Times since the first frame of the stream.
    columns : ndarray, shape (frames, columns)
        Reduced profiles.
    frame_rate_hz : float
    span_s : tuple of int
        Start and end of the window.
    min_snr : float
        Least tone power over the noise power in a resolution cell.
    """
    length_s = float(span_s[1] - span_s[0])
    finder = ToneFinder(length_s, SEARCH_HZ)
    t_mid = t_s - sum(span_s) / 2.0
    best: tuple[float, float, Tone, Complex] | None = None
    for nominal_hz in nominals_hz:
        if abs(alias_hz(2.0 * nominal_hz, frame_rate_hz)) < SEARCH_HZ:
            continue  # near 0 Hz a brightness drift looks like a tone
        carrier = np.exp(-4j * np.pi * nominal_hz * t_s)
        turns = turns_grid(basis, nominal_hz, frame_rate_hz)
        series = columns @ basis.ramps(turns).conj()
        _, power = finder.periodograms(series * carrier[:, None], carrier, t_mid)
        for i in range(turns.size):
            tone = strongest(finder, power[:, i], t_mid)
            if best is None or _rank(tone, min_snr) > _rank(best[2], min_snr):
                best = nominal_hz, float(turns[i]), tone, series[:, i] * carrier
    if best is None or not stands_out(best[2], min_snr):
        return NO_FLICKER
    nominal_hz, one_turns, tone, baseband = best
    if tone.at_edge:
        return AT_EDGE
    mirrored_hz = _mirrored_hz(tone.offset_hz, one_turns, nominal_hz, frame_rate_hz)
    if mirrored_hz is not None:
        one_turns, tone = -one_turns, replace(tone, offset_hz=mirrored_hz)
        baseband = baseband.conj() * np.exp(-8j * np.pi * nominal_hz * t_s)
    nodes_t = np.arange(round(length_s / NODE_S) + 1) * NODE_S - length_s / 2.0
    offset_hz, drift_hz_s = _with_drift(baseband, t_mid, tone.offset_hz, finder)
    psi = 2.0 * np.pi * (offset_hz * nodes_t + drift_hz_s * nodes_t**2 / 2.0)
    return AcquiredFlicker(nominal_hz, one_turns, tone, psi)


def may_stand_still(nominal_hz: float, frame_rate_hz: float, rows: int) -> bool:
    """Whether the alias's search band includes 0 Hz, with enough rows for a ramp.

    Parameters
    ----------
    nominal_hz, frame_rate_hz : float
    rows : int
    """
    return rows >= MIN_ROWS and abs(alias_hz(2.0 * nominal_hz, frame_rate_hz)) < SEARCH_HZ


def _mirrored_hz(
    offset_hz: float, turns: float, nominal_hz: float, frame_rate_hz: float
) -> float | None:
    """Offset of a tone's mirror image, if the image is the better interpretation; else None.

    Near half the frame rate a tone with a ramp down the rows and its mirror image with the ramp up
    the rows fit equally well. The one nearer to the nominal frequency is taken; on a tie the ramp
    down, since the first row is usually read first.
    """
    mirrored_hz = alias_hz(-4.0 * nominal_hz - offset_hz, frame_rate_hz)
    if turns == 0.0 or abs(mirrored_hz) > SEARCH_HZ:
        return None
    nearer_hz = abs(offset_hz) - abs(mirrored_hz)
    is_better = nearer_hz > (-TIED_HZ if turns < 0.0 else TIED_HZ)
    return mirrored_hz if is_better else None


def strongest(finder: ToneFinder, power: Float, t_s: Float) -> Tone:
    """Strongest tone; its SNR refers to the larger of the noise beside it and in the whole band.

    With so many ramps tried, some have little noise beside the tone by chance.
    """
    tone = finder.strongest(power, t_s)
    noise = float(np.median(power)) / np.log(2.0)
    snr = min(tone.snr, tone.amplitude**2 / noise) if noise > 0.0 else tone.snr
    return replace(tone, snr=float(snr))


def _rank(tone: Tone, min_snr: float) -> tuple[bool, float]:
    """Sort key: tones above the threshold first, by amplitude; the others by SNR."""
    clear = stands_out(tone, min_snr) and not tone.at_edge
    return clear, tone.amplitude if clear else tone.snr


def stands_out(tone: Tone, min_snr: float) -> bool:
    """Whether a tone exceeds a threshold that grows with its distance from the nominal frequency.

    In log odds: noise power is exponentially distributed, the prior of the offset Gaussian.
    """
    return tone.snr >= min_snr + (tone.offset_hz / LIKELY_HZ) ** 2 / 2.0


def turns_grid(basis: ProfileBasis, nominal_hz: float, frame_rate_hz: float) -> Float:
    """Turns to try: read-out times up to a frame period in both directions; 0 for a single row."""
    if basis.rows == 1:
        return np.zeros(1)
    most = int(np.ceil(2.0 * nominal_hz / frame_rate_hz / TURNS_STEP))
    return np.asarray(np.arange(-most, most + 1) * TURNS_STEP, np.float64)


def _with_drift(
    baseband: Complex, t_s: Float, offset_hz: float, finder: ToneFinder
) -> tuple[float, float]:
    """Frequency offset (Hz) and drift (Hz/s) of largest power near a peak."""
    near = np.abs(finder.offsets_hz - offset_hz) <= NEAR_HZ
    offsets = finder.offsets_hz[near]
    straight = np.exp(-2j * np.pi * np.outer(offsets, t_s)) * finder.window(t_s)
    bend = np.exp(-1j * np.pi * np.outer(t_s**2, DRIFTS_HZ_S)) * baseband[:, None]
    power = np.abs(straight @ bend)
    i, j = np.unravel_index(int(np.argmax(power)), power.shape)
    return float(offsets[i]), float(DRIFTS_HZ_S[j])


# Means along the axis: five for each turn at 10 frames/s and 60 Hz.
BANDS = 64
# Half-width of the band searched around the flicker's alias: half a hertz of the grid.
# Step between the frequencies tried, in units of 1 / duration.
FREQUENCY_STEP = 0.25
# Least power of a ramp over the noise in a cell: noise alone reaches it in one search of 10^7.
MIN_AXIS_SNR = 25.0
# Least power ratio of the ramp to the one that turns the other way, to those at other frequencies
# (at least so many cells away), and of one axis to the other.
MIN_CONTRAST, BESIDE = 4.0, 2.5
# Power of a ramp with an amplitude of 0.002 of the light: weaker ones may come from a codec.
MIN_POWER = 4e-6
# Slower frames tell no grid; where stamps leap, all that is tried would fill the memory.
MIN_RATE_HZ = 5.0
# Bands darker than this (levels) are mostly noise, and ignored.
MIN_LEVEL = 1.0


def find_axis(by_rows: Sequence[RowBlock], by_columns: Sequence[RowBlock]) -> str:
    """Find the read-out axis from the same frames, sampled along both axes.

    Parameters
    ----------
    by_rows, by_columns : sequence of RowBlock

    Returns
    -------
    str
        'rows' or 'columns'; empty if no flicker ramp shows along either, or both are about as
        strong.
    """
    # Turning ramps first: motion may look like a static ramp, but hardly like a turning one.
    for rows, columns in zip(ramp_powers(by_rows), ramp_powers(by_columns), strict=True):
        if columns > MIN_CONTRAST * rows:
            return "columns"
        if rows > MIN_CONTRAST * columns:
            return "rows"
    return ""


def ramp_powers(blocks: Sequence[RowBlock]) -> tuple[float, float]:
    """Power of the strongest significant flicker ramps relative to the light's power; 0 for none.

    First of ramps that turn from frame to frame, then of those whose alias is near 0 Hz.
    """
    t_s, level = _bands(blocks)
    if t_s.size < 2 or t_s[-1] <= 0 or level.shape[1] < 4:
        return 0.0, 0.0
    frame_rate_hz = (t_s.size - 1) / float(t_s[-1])
    if frame_rate_hz < MIN_RATE_HZ:
        return 0.0, 0.0
    mean = level.mean(axis=0)
    # Relative to each band's mean, which divides out the scene's reflectance.
    relative = np.where(mean > MIN_LEVEL, level / np.maximum(mean, MIN_LEVEL) - 1.0, 0.0)
    turning = standing = 0.0
    for line in (Line(50.0, 1, 0), Line(60.0, 1, 0)):
        stands_still = abs(line.alias_hz(frame_rate_hz)) <= SEARCH_HZ
        power = _at_grid(line, relative, t_s, frame_rate_hz, stands_still=stands_still)
        turning = max(turning, 0.0 if stands_still else power)
        standing = max(standing, power if stands_still else 0.0)
    return turning, standing


def _bands(blocks: Sequence[RowBlock]) -> tuple[Float, Float]:
    """Frame times (s) and means of bands of rows, (frames, bands), of the usable blocks."""
    usable = [b for b in blocks if b.usable and b.rows == blocks[0].rows]
    if not usable:
        return np.empty(0), np.empty((0, 0))
    level = np.concatenate([b.profiles() for b in usable])
    bands = min(BANDS, level.shape[1])
    starts = np.arange(bands) * level.shape[1] // bands
    sizes = np.diff(np.append(starts, level.shape[1]))
    pts_ns = np.concatenate([b.frame_pts_ns for b in usable])
    return (pts_ns - pts_ns[0]) / NS_PER_S, np.add.reduceat(level, starts, axis=1) / sizes


def _at_grid(
    line: Line, relative: Float, t_s: Float, frame_rate_hz: float, *, stands_still: bool
) -> float:
    """Power of the strongest significant ramp near a grid's alias; 0 for none."""
    duration_s = float(t_s[-1])
    weights = np.sin(np.pi * t_s / duration_s) ** 2
    weights /= weights.sum()
    offsets_hz = np.arange(-SEARCH_HZ, SEARCH_HZ, FREQUENCY_STEP / duration_s)
    turning = np.exp(-2j * np.pi * np.outer(line.carrier_hz + offsets_hz, t_s)) * weights
    tones = turning @ (relative - weights @ relative)  # (offsets, bands)
    ramps = _ramps(relative.shape[1], line.turns(frame_rate_hz))
    if not ramps.size:  # of frames that are too short for any
        return 0.0
    down, up = (np.abs(tones @ r) ** 2 for r in (ramps, ramps.conj()))
    noise = max(float(np.median(p)) / np.log(2.0) for p in (down, up))
    found = 0.0
    for power, mirrored in ((down, up), (up, down)):
        at = np.unravel_index(np.argmax(power), power.shape)
        # Motion makes ramps as well, but at all frequencies.
        beside = power[np.abs(offsets_hz - offsets_hz[at[0]]) > BESIDE / duration_s, at[1]]
        rival = max(0.0 if stands_still else float(mirrored[at]), float(beside.max(initial=0.0)))
        if power[at] > max(MIN_AXIS_SNR * noise, MIN_CONTRAST * rival, MIN_POWER):
            found = max(found, float(power[at]))
    return found


def _ramps(bands: int, most_turns: float) -> NDArray[np.complex128]:
    """Conjugated ramps of up to ``most_turns`` turns, less their mean, shape (bands, ramps)."""
    turns = np.arange(2 * TURNS_STEP, most_turns + TURNS_STEP, TURNS_STEP)
    place = (np.arange(bands) + 0.5) / bands
    ramps = np.exp(-2j * np.pi * np.outer(place, turns)) / bands
    return np.asarray(ramps - ramps.mean(axis=0), np.complex128)
