"""Which way the sensor was read out: along rows or along columns.

Flicker runs along the read-out axis as a ramp of phase (:mod:`rsenf.flicker.lines`). Across it,
every line holds the same mean of all phases: the flicker may show there, but it stands still. What
all lines have in common is therefore left out, and the ramp must turn one way: a standing pattern
whose brightness changes is as strong on the ramp that turns the other way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import Line
from rsenf.flicker.tone import ToneFinder
from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S

Float = NDArray[np.float64]

# Means along the axis that are looked at: five for each turn at 10 frames/s and 60 Hz.
BANDS = 64
# Deviation of the grid's frequency from its nominal that is searched.
SEARCH_HZ = 0.5
# Between the ramps tried; half of it loses a twentieth of the power.
TURNS_STEP = 0.25
# Of a ramp over the noise in a cell: noise alone reaches it in one search of 10^7.
MIN_SNR = 25.0
# Of the ramp over the one that turns the other way, and of one axis over the other.
MIN_CONTRAST = 4.0
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
    rows, columns = ramp_power(by_rows), ramp_power(by_columns)
    if columns > MIN_CONTRAST * rows:
        return "columns"
    return "rows" if rows > MIN_CONTRAST * columns else ""


def ramp_power(blocks: Sequence[RowBlock]) -> float:
    """Power of the strongest ramp of flicker that surely is one, relative to the light's; or 0."""
    t_s, level = _bands(blocks)
    if t_s.size < 2 or level.shape[1] < 4:
        return 0.0
    duration_s = float(t_s[-1] - t_s[0])
    frame_rate_hz = (t_s.size - 1) / duration_s if duration_s > 0 else 0.0
    if frame_rate_hz <= 0.0:
        return 0.0
    mean = level.mean(axis=0)
    # Relative to each band's mean: what the scene reflects is divided out.
    relative = np.where(mean > MIN_LEVEL, level / np.maximum(mean, MIN_LEVEL) - 1.0, 0.0)
    return max(_at_grid(Line(hz, 1, 0), relative, t_s, frame_rate_hz) for hz in (50.0, 60.0))


def _bands(blocks: Sequence[RowBlock]) -> tuple[Float, Float]:
    """Frame times (s) and means of bands of rows, (frames, bands), of the usable blocks."""
    usable = [b for b in blocks if b.usable and b.rows == blocks[0].rows]
    if not usable:
        return np.empty(0), np.empty((0, 0))
    level = np.concatenate([b.level.mean(axis=2, dtype=np.float64) for b in usable])
    bands = min(BANDS, level.shape[1])
    starts = np.arange(bands) * level.shape[1] // bands
    sizes = np.diff(np.append(starts, level.shape[1]))
    pts_ns = np.concatenate([b.frame_pts_ns for b in usable])
    return (pts_ns - pts_ns[0]) / NS_PER_S, np.add.reduceat(level, starts, axis=1) / sizes


def _at_grid(line: Line, relative: Float, t_s: Float, frame_rate_hz: float) -> float:
    """Power of the strongest one-sided ramp near a grid's alias; 0 for none."""
    finder = ToneFinder(float(t_s[-1]), 2.0 * SEARCH_HZ)
    centred_s = t_s - t_s[-1] / 2.0
    carrier = np.exp(-2j * np.pi * line.carrier_hz * centred_s)
    tones, _ = finder.periodograms(relative * carrier[:, None], carrier, centred_s)
    turns = np.arange(2 * TURNS_STEP, line.turns(frame_rate_hz) + TURNS_STEP, TURNS_STEP)
    if turns.size == 0:  # more than twice the flicker's frequency: under half a turn down a frame
        turns = np.array([line.turns(frame_rate_hz)])
    place = (np.arange(relative.shape[1]) + 0.5) / relative.shape[1]
    ramps = np.exp(-2j * np.pi * np.outer(place, turns))
    ramps -= ramps.mean(axis=0)
    down, up = (np.abs(tones @ r / place.size) ** 2 for r in (ramps, ramps.conj()))
    inside = np.abs(finder.offsets_hz) <= 2.0 * SEARCH_HZ
    noise = max(float(np.median(p)) / np.log(2.0) for p in (down, up))
    found = 0.0
    for power, mirrored in ((down, up), (up, down)):
        at = np.unravel_index(np.argmax(power * inside[:, None]), power.shape)
        if power[at] > max(MIN_SNR * noise, MIN_CONTRAST * mirrored[at]):
            found = max(found, float(power[at]))
    return found
