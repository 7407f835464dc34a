"""The phase that a reference foretells: its frequency, integrated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.match.clip_phase import RAD_PER_CYCLE
from rsenf.match.series import Grid
from rsenf.messages.schema import FloatArray

_BESIDE = 2  # samples beyond the clip's ends, for the slopes


def forecast(
    grid: Grid, lag_s: FloatArray, t_s: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Phase of the illumination at the instants of a clip, were it to begin at given lags.

    The mean frequency over a sample moves the phase from one of its ends to the other; in between
    the frequency is a line whose slope is that of the samples on either side.

    Parameters
    ----------
    grid : Grid
        Read in one slice for each lag.
    lag_s : ndarray, shape (c,)
        Clip's start less the reference's.
    t_s : ndarray, shape (n,)
        Instants of the clip, rising.

    Returns
    -------
    phase_rad : ndarray, shape (n, c)
        Less that of twice the nominal frequency, up to a constant of each lag.
    known : ndarray of bool, shape (n, c)
        Whether the way from the instant before lies within the reference, and not in a gap.
    """
    phase = np.empty((t_s.size, lag_s.size))
    known = np.zeros((t_s.size, lag_s.size), bool)
    for c, lag in enumerate(lag_s):
        phase[:, c], known[:, c] = _one(grid, (lag + t_s) / grid.step_s)
    return phase, known


def _one(grid: Grid, at: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The same at one lag, for instants in samples of the reference."""
    first = int(np.floor(at[0])) - _BESIDE
    away = samples(grid, first, int(np.ceil(at[-1])) + _BESIDE) - grid.nominal_hz
    gap = np.isnan(away)
    mean = np.where(gap, 0.0, away)
    slope = np.zeros_like(mean)
    slope[1:-1] = np.where(gap[2:] | gap[:-2], 0.0, (mean[2:] - mean[:-2]) / 2.0)
    edges = np.concatenate([[0.0], np.cumsum(mean)])
    missing = np.concatenate([[0], np.cumsum(gap)])
    whole = np.floor(at).astype(np.int64)
    part, k = at - whole, whole - first
    cycles = edges[k] + mean[k] * part + slope[k] * (part**2 - part) / 2.0
    end = k + (part > 0.0)
    known = np.zeros(at.size, bool)
    known[1:] = missing[end[1:]] == missing[k[:-1]]
    return RAD_PER_CYCLE * grid.step_s * cycles, known


def samples(grid: Grid, start: int, stop: int) -> FloatArray:
    """Samples of a reference, NaN beyond its ends too."""
    out = np.full(stop - start, np.nan)
    a, b = max(start, 0), min(stop, grid.freq_hz.size)
    if a < b:
        out[a - start : b - start] = grid.freq_hz[a:b]
    return out
