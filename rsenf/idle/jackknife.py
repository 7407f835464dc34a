"""Jackknife standard error of a ramp, which holds after a codec as well.

A codec's errors aren't noise: they are on its blocks of rows, last as long as the clip, and lean
the same way over several blocks, as slices and prediction make them. So the ramp is estimated again
with one band of rows after another left out, and the scatter gives its error (jackknife; Efron, B.
and Stein, C. (1981), Annals of Statistics 9, 586); and the deviation of the rows' phases from one
line gives the possible error of the line itself. White noise sets the floor.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from rsenf.idle.ramp import THREE, Profile, climb, step_up

Float = NDArray[np.float64]

BAND_ROWS = 48  # three macroblocks of H.264
MIN_BANDS = 10
BENDS = 7  # polynomials: from the straight line on, up to what a tenth of the rows resolves
NEAR = 0.02  # turns, up to which one step is enough: the peak is two turns wide


def bands(rows: int) -> NDArray[np.int64]:
    """First row of each band."""
    count = min(max(rows // BAND_ROWS, MIN_BANDS), rows)
    return np.arange(count) * rows // count


def left_out(rows: int) -> Float:
    """Weights that leave out one band each, shape (bands, rows)."""
    starts = bands(rows)
    band = np.searchsorted(starts, np.arange(rows), side="right") - 1
    return np.asarray(band[None, :] != np.arange(starts.size)[:, None], np.float64)


def jackknife_var(profile: Profile, turns: float) -> float:
    """Variance of the turns by leaving out bands of rows.

    Mostly the maximum without a band is close to that of all rows: one step from there is exact to
    such a high order that all bands can share its sums.

    Parameters
    ----------
    profile : Profile
    turns : float
        Maximum of all rows.
    """
    starts = bands(profile.brightness.size)
    move, _ = step_up(profile.without_each(turns + THREE, starts))
    without = turns + move
    for band in np.flatnonzero(np.abs(move) > NEAR):
        without[band], _ = climb(partial(_without, profile, starts, int(band)), turns)
    return float((starts.size - 1) * np.var(without))


def bends(weight: Float) -> Float:
    """Polynomials down the rows from the straight line on, shape (orders, rows).

    Orthogonal under the rows' weights, and scaled to the size of the straight line.
    """
    root = np.sqrt(weight)[:, None]
    place = (np.arange(weight.size) + 0.5) / weight.size
    shapes, size = np.linalg.qr(np.vander(place, BENDS + 1, increasing=True) * root)
    return np.asarray((shapes / root * size[1, 1]).T[1:])


def bend_var(profile: Profile, turns: float) -> float:
    """Variance of the turns if the phases have a slope as large as their bends.

    Errors that lean the same way over many rows affect neighbouring bands alike, and the jackknife
    underestimates them. Their slope is taken for read-out; their higher polynomials aren't, and are
    taken to be as large each. White noise makes all of them, and so the variance, equal the bound.

    Parameters
    ----------
    profile : Profile
    turns : float
        Maximum of all rows.
    """
    move, bend = step_up(profile.bent(turns, bends(profile.brightness**2)))
    return float(np.mean(move[1:] ** 2 * np.maximum(bend[1:], 0.0)) / bend[0])


def freedom(rows: int) -> float:
    """Degrees of freedom of the jackknife's variance (Satterthwaite's).

    Bands act on a slope by the square of their distance from the middle: ``(Σx²)²/Σx⁴``.
    """
    return 5.0 / 9.0 * bands(rows).size


def _without(profile: Profile, starts: NDArray[np.int64], band: int, turns: Float) -> Float:
    return np.asarray(profile.without_each(turns, starts)[:, band])
