"""Removes outliers: estimates that jump away from their neighbours, as no windowed grid does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsenf.match.series import Track
from rsenf.messages.schema import FloatArray

# A day of the continental grid, averaged by a 20 s window, stays within 8 mHz of its running median
# over 20 s. A value further away *and* far outside the clip's scatter is a wrong spectral peak; a
# few of those would make the right time look impossible.
LEAST_JUMP_HZ = 0.010
SCATTERS = 8.0  # standard deviations, from the median absolute deviation


def without_jumps(track: Track) -> tuple[Track, int]:
    """Replace the estimates that no grid can have made by holes.

    An outlier is further from the running median than both limits below.

    Returns
    -------
    track : Track
    dropped : int
        Number of outliers.
    """
    away = np.abs(track.enf_hz - _running_median(track.enf_hz, track.resolution_s / track.hop_s))
    if not np.isfinite(away).any():
        return track, 0
    scatter = 1.4826 * float(np.nanmedian(away))
    jumps = np.nan_to_num(away, nan=0.0) > max(SCATTERS * scatter, LEAST_JUMP_HZ)
    return replace(track, enf_hz=np.where(jumps, np.nan, track.enf_hz)), int(jumps.sum())


def _running_median(values: FloatArray, width: float) -> FloatArray:
    """Median of the valid values within half a width on either side; NaN if there are none."""
    half = max(round(width / 2), 1)
    padded = np.pad(values, half, constant_values=np.nan)
    ordered = np.sort(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    rows = np.arange(values.size)
    low, high = np.maximum(count - 1, 0) // 2, count // 2
    high = np.minimum(high, np.maximum(count - 1, 0))
    return np.asarray((ordered[rows, low] + ordered[rows, high]) / 2, np.float64)
