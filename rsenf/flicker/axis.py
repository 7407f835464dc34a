"""Finds the read-out axis of the sensor: along rows or along columns.

Along the read-out axis flicker is a phase ramp (:mod:`rsenf.flicker.lines`). Across it every line
averages the same mixture of phases: flicker may show, but with one phase everywhere. So the part
common to all lines is subtracted, and the ramp must be stronger than the one that turns the other
way: a standing pattern of varying brightness is equally strong on both. Where the frame rate
divides the flicker's frequency the ramp hardly moves and both ways look alike; there only the
power along the two axes is compared.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import Line
from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S

Float = NDArray[np.float64]

# Means along the axis: five for each turn at 10 frames/s and 60 Hz.
BANDS = 64
# Half-width of the band searched around the flicker's alias: half a hertz of the grid.
SEARCH_HZ = 1.0
# Steps between the ramps tried, and between the frequencies in units of 1 / duration.
TURNS_STEP, FREQUENCY_STEP = 0.25, 0.25
# Least power of a ramp over the noise in a cell: noise alone reaches it in one search of 10^7.
MIN_SNR = 25.0
# Least power ratio of the ramp to the one that turns the other way, to those at other frequencies
# (at least so many cells away), and of one axis to the other.
MIN_CONTRAST, BESIDE = 4.0, 2.5
# Power of a ramp with an amplitude of 0.002 of the light: weaker ones may come from a codec.
MIN_POWER = 4e-6
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
    down, up = (np.abs(tones @ r) ** 2 for r in (ramps, ramps.conj()))
    noise = max(float(np.median(p)) / np.log(2.0) for p in (down, up))
    found = 0.0
    for power, mirrored in ((down, up), (up, down)):
        at = np.unravel_index(np.argmax(power), power.shape)
        # Motion makes ramps as well, but at all frequencies.
        beside = power[np.abs(offsets_hz - offsets_hz[at[0]]) > BESIDE / duration_s, at[1]]
        rival = max(0.0 if stands_still else float(mirrored[at]), float(beside.max(initial=0.0)))
        if power[at] > max(MIN_SNR * noise, MIN_CONTRAST * rival, MIN_POWER):
            found = max(found, float(power[at]))
    return found


def _ramps(bands: int, most_turns: float) -> NDArray[np.complex128]:
    """Conjugated ramps of up to ``most_turns`` turns, less their mean, shape (bands, ramps)."""
    turns = np.arange(2 * TURNS_STEP, most_turns + TURNS_STEP, TURNS_STEP)
    place = (np.arange(bands) + 0.5) / bands
    ramps = np.exp(-2j * np.pi * np.outer(place, turns)) / bands
    return np.asarray(ramps - ramps.mean(axis=0), np.complex128)
