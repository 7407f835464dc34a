"""Is the clip's ENF one that its references' grids may have? If not, its frame times are wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsenf.match.series import Grid, Track

# Grids stay nearer to their nominal frequency, but for a few minutes in many years: then the
# reference shows it.
FARTHEST_HZ, NEAR_HZ = 0.1, 0.02
PIECE = 1 << 20  # samples of a reference looked at together


def off_speed(track: Track, grids: Sequence[Grid]) -> str:
    """Say that the clip's ENF is too far from the nominal one; empty where it isn't."""
    enf_hz = float(np.nanmedian(track.enf_hz))
    away_hz = enf_hz - track.nominal_hz
    if abs(away_hz) <= FARTHEST_HZ or any(_comes_near(grid, enf_hz) for grid in grids):
        return ""
    percent = abs(away_hz) / track.nominal_hz * 100
    return (
        f"the clip's ENF is {abs(away_hz):.2f} Hz ({percent:.1f} %) "
        f"{'above' if away_hz > 0 else 'below'} {track.nominal_hz:g} Hz, where the reference never "
        "is: played at another speed, or wrong frame times?"
    )


def _comes_near(grid: Grid, enf_hz: float) -> bool:
    pieces = (grid.freq_hz[k : k + PIECE] for k in range(0, grid.freq_hz.size, PIECE))
    return any((np.abs(piece - enf_hz) < NEAR_HZ).any() for piece in pieces)
