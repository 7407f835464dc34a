"""Which way the sensor was read out: along rows or along columns.

Flicker runs along the read-out axis as a ramp of phase (:mod:`rsenf.flicker.lines`). Across it,
every line holds the same mean of all phases: the flicker may show there, but it stands still. What
all lines have in common is therefore left out, and the ramp must turn one way: a standing pattern
whose brightness changes is as strong on the ramp that turns the other way. Where the frame rate
divides the flicker's frequency the ramp hardly moves and both ways look alike; there, that it is
much stronger along one axis has to do.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import Line
from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S

Float = NDArray[np.float64]

# Means along the axis that are looked at: five for each turn at 10 frames/s and 60 Hz.
BANDS = 64
# Half-width of the band searched around the flicker's alias: half a hertz of the grid.
SEARCH_HZ = 1.0
# Between the ramps tried, and between the frequencies in units of 1 / duration.
TURNS_STEP, FREQUENCY_STEP = 0.25, 0.25
# Of a ramp over the noise in a cell: noise alone reaches it in one search of 10^7.
MIN_SNR = 25.0
# Of the ramp over the one that turns the other way, over those beside it (from so many cells on),
# and of one axis over the other.
MIN_CONTRAST, BESIDE = 4.0, 2.5
# Power of a ramp with an amplitude of two thousandths of the light: less may be a codec's doing.
MIN_POWER = 4e-6
# Darker than this (levels) a band is noise over nothing.
MIN_LEVEL = 1.0


def find_axis(by_rows: Sequence[RowBlock], by_columns: Sequence[RowBlock]) -> str:
    """Tell the read-out axis by the same frames, sampled along both.

    Returns
    -------
    str
        'rows' or 'columns'; empty when no ramp of flicker shows along either, or when both are
        about as strong.
    """
    # What moves may look like a ramp that stands still, but hardly like one that turns.
    for rows, columns in zip(ramp_powers(by_rows), ramp_powers(by_columns), strict=True):
        if columns > MIN_CONTRAST * rows:
            return "columns"
        if rows > MIN_CONTRAST * columns:
            return "rows"
    return ""


def ramp_powers(blocks: Sequence[RowBlock]) -> tuple[float, float]:
    """Power of the strongest ramps of flicker that surely are some, relative to the light's; or 0.

    Of one that turns from frame to frame, and of one that may stand still.
    """
    t_s, level = _bands(blocks)
    if t_s.size < 2 or t_s[-1] <= 0 or level.shape[1] < 4:
        return 0.0, 0.0
    frame_rate_hz = (t_s.size - 1) / float(t_s[-1])
    mean = level.mean(axis=0)
    # Relative to each band's mean: what the scene reflects is divided out.
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
    """Power of the strongest ramp near a grid's alias; 0 for none that surely is one."""
    duration_s = float(t_s[-1])
    weights = np.sin(np.pi * t_s / duration_s) ** 2
    weights /= weights.sum()
    offsets_hz = np.arange(-SEARCH_HZ, SEARCH_HZ, FREQUENCY_STEP / duration_s)
    turning = np.exp(-2j * np.pi * np.outer(line.carrier_hz + offsets_hz, t_s)) * weights
    tones = turning @ (relative - weights @ relative)  # (offsets, bands)
    ramps = _ramps(relative.shape[1], line.turns(frame_rate_hz))
    down, up = (np.abs(tones @ r) ** 2 for r in (ramps, ramps.conj()))
    noise = max(float(np.median(p)) / np.log(2.0) for p in (down, up))
    found = 0.0
    for power, mirrored in ((down, up), (up, down)):
        at = np.unravel_index(np.argmax(power), power.shape)
        # What moves makes ramps as well, but at all frequencies.
        beside = power[np.abs(offsets_hz - offsets_hz[at[0]]) > BESIDE / duration_s, at[1]]
        rival = max(0.0 if stands_still else float(mirrored[at]), float(beside.max(initial=0.0)))
        if power[at] > max(MIN_SNR * noise, MIN_CONTRAST * rival, MIN_POWER):
            found = max(found, float(power[at]))
    return found


def _ramps(bands: int, most_turns: float) -> NDArray[np.complex128]:
    """Conjugated ramps of up to so many turns, blind to what all bands share, (bands, ramps)."""
    turns = np.arange(2 * TURNS_STEP, most_turns + TURNS_STEP, TURNS_STEP)
    place = (np.arange(bands) + 0.5) / bands
    ramps = np.exp(-2j * np.pi * np.outer(place, turns)) / bands
    return np.asarray(ramps - ramps.mean(axis=0), np.complex128)
