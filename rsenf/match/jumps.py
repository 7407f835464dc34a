"""Estimates that jump away from their neighbours: the window makes that impossible for a grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsenf.match.series import Track
from rsenf.messages.schema import FloatArray

# A day of the continental grid, averaged as a 20 s window does, stays within 8 mHz of its own
# running median over 20 s; what is further away *and* far outside the clip's own scatter is a
# wrong peak. A few of those would make the right time look impossible.
LEAST_JUMP_HZ = 0.010
SCATTERS = 8.0


def without_jumps(track: Track) -> tuple[Track, int]:
    """Leave out the estimates that no grid can have made.

    Returns
    -------
    track : Track
        With a hole for each of them.
    dropped : int
        How many there were.
    """
    away = np.abs(track.enf_hz - _running_median(track.enf_hz, track.resolution_s / track.hop_s))
    if not np.isfinite(away).any():
        return track, 0
    scatter = 1.4826 * float(np.nanmedian(away))
    jumps = np.nan_to_num(away, nan=0.0) > max(SCATTERS * scatter, LEAST_JUMP_HZ)
    return replace(track, enf_hz=np.where(jumps, np.nan, track.enf_hz)), int(jumps.sum())


def _running_median(values: FloatArray, width: float) -> FloatArray:
    """Median of the valid values within half a width on either side; NaN where there is none."""
    half = max(round(width / 2), 1)
    padded = np.pad(values, half, constant_values=np.nan)
    ordered = np.sort(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    rows = np.arange(values.size)
    low, high = np.maximum(count - 1, 0) // 2, count // 2
    high = np.minimum(high, np.maximum(count - 1, 0))
    return np.asarray((ordered[rows, low] + ordered[rows, high]) / 2, np.float64)
