"""Jackknife standard error of a ramp: it holds after a codec, too.

A codec's errors are no noise: they sit on its blocks of rows, stay as long as the clip lasts, and
lean the same way over several blocks, as slices and prediction make them. So the ramp is found
again with one band of rows after another left out, and the scatter says how far it can be trusted
(the jackknife; Efron & Stein, Annals of Statistics 9, 586, 1981); and how far the rows' phases are
from one line says what the line itself may be wrong by. White noise sets the floor.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from rsenf.idle.ramp import THREE, Profile, climb, step_up

Float = NDArray[np.float64]

BAND_ROWS = 48  # three macroblocks of H.264
MIN_BANDS = 10
BENDS = 7  # polynomials: from the straight line on, up to what a tenth of the rows tells
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

    Without a band the top is close to that of all rows, mostly: a single step from there is exact
    to so high an order that all bands can share its sums.
    """
    starts = bands(profile.brightness.size)
    move, _ = step_up(profile.without_each(turns + THREE, starts))
    without = turns + move
    for band in np.flatnonzero(np.abs(move) > NEAR):
        without[band], _ = climb(partial(_without, profile, starts, int(band)), turns)
    return float((starts.size - 1) * np.var(without))


def bends(weight: Float) -> Float:
    """Polynomials down the rows from the straight line on, shape (orders, rows).

    Orthogonal under the rows' weights, and all of the straight line's size.
    """
    root = np.sqrt(weight)[:, None]
    place = (np.arange(weight.size) + 0.5) / weight.size
    shapes, size = np.linalg.qr(np.vander(place, BENDS + 1, increasing=True) * root)
    return np.asarray((shapes / root * size[1, 1]).T[1:])


def bend_var(profile: Profile, turns: float) -> float:
    """Variance of the turns if the rows' phases lean as far as they bend.

    What leans the same way over many rows acts alike on neighbouring bands, and the jackknife sees
    too little of it. Its slope is taken for read-out; its further polynomials aren't, and are taken
    to be as large each. White noise makes all of them, and so the variance, what the bound is.
    """
    move, bend = step_up(profile.bent(turns, bends(profile.brightness**2)))
    return float(np.mean(move[1:] ** 2 * np.maximum(bend[1:], 0.0)) / bend[0])


def freedom(rows: int) -> float:
    """Degrees of freedom of the jackknife's variance (Satterthwaite's).

    Bands act on a slope by the square of how far they are from the middle: ``(Σx²)²/Σx⁴``.
    """
    return 5.0 / 9.0 * bands(rows).size


def _without(profile: Profile, starts: NDArray[np.int64], band: int, turns: Float) -> Float:
    return np.asarray(profile.without_each(turns, starts)[:, band])
