"""Interpolation of the rows missing in the idle period, from the frames on either side.

Every interpolation here is linear in the rows of the two frames, and the same for all frames. So
it needs a few numbers of each frame only (``features`` of its rows), and its part of a spectral
line is computed without making a single row (:mod:`rsenf.track.paper_templates`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

# Rows averaged at a frame's edge for the ends of a straight line: a single one is noisy.
EDGE_RATIO = 0.02


@dataclass(frozen=True, eq=False)
class Fill:
    """Linear map from two frames to the rows missing between them.

    With ``f = features.T @ rows`` of the frame before and of the frame after, the missing rows
    are ``before @ f_before + after @ f_after``.

    Parameters
    ----------
    features : ndarray, shape (rows, k)
        Weights of a frame's rows.
    before, after : ndarray, shape (gap, k)
        Weights of the two frames' features for each missing row, in the order of time.
    """

    features: Float
    before: Float
    after: Float


def neighbour_mean(rows: int, gap: int, turns: float) -> Fill:
    """Mean of all rows of both frames (paper, Section V): the same for every missing row.

    Parameters
    ----------
    rows, gap : int
        Rows of a frame, and missing rows.
    turns : float
        Turns of the flicker's phase from row to row.
    """
    half = np.full((gap, 1), 0.5)
    return Fill(np.full((rows, 1), 1.0 / rows), half, half)


def neighbour_rows(rows: int, gap: int, turns: float) -> Fill:
    """Mean of the same row of both frames, from the first down, and again from the first.

    Another reading of the paper's "averaging the samples of the previous and of the next frame".
    """
    half = 0.5 * np.eye(rows)[np.arange(gap) % rows]
    return Fill(np.eye(rows), half, half)


def linear(rows: int, gap: int, turns: float) -> Fill:
    """Straight line in time from the last rows of one frame to the first rows of the next.

    Examples
    --------
    >>> fill = linear(4, 3, 0.0)
    >>> frame = fill.features.T @ np.array([1.0, 2.0, 3.0, 5.0])
    >>> (fill.before @ frame + fill.after @ frame).tolist()
    [4.0, 3.0, 2.0]
    """
    edge = max(round(EDGE_RATIO * rows), 1)
    features = np.zeros((rows, 2))
    features[:edge, 0] = features[rows - edge :, 1] = 1.0 / edge
    share = (np.arange(gap) + 1.0) / (gap + 1.0)
    nothing = np.zeros(gap)
    return Fill(
        features, np.stack([nothing, 1.0 - share], axis=1), np.stack([share, nothing], axis=1)
    )


def harmonic(rows: int, gap: int, turns: float) -> Fill:
    """A constant and a sine at ``f_0``, fitted to all rows of both frames by least squares."""
    basis = _sine(np.arange(rows), turns)
    # The frame before began rows + gap earlier: its sine is the same one, rotated.
    turned = _sine(np.arange(rows) - (rows + gap), turns)
    turn = np.linalg.lstsq(basis, turned, rcond=None)[0]
    inverse = np.linalg.pinv(basis.T @ basis + turned.T @ turned, hermitian=True)
    missing = _sine(np.arange(-gap, 0), turns)
    return Fill(basis, missing @ inverse @ turn.T, missing @ inverse)


def _sine(place: NDArray[np.int64], turns: float) -> Float:
    """Constant, cosine and sine at places along the rows, shape (places, 3)."""
    angle = 2.0 * np.pi * turns * place
    return np.stack([np.ones(place.size), np.cos(angle), np.sin(angle)], axis=1)


def none(rows: int, gap: int, turns: float) -> Fill:
    """No interpolation: missing rows are 0, and the ramp down the rows is a matched filter."""
    return Fill(np.zeros((rows, 0)), np.zeros((gap, 0)), np.zeros((gap, 0)))


# Functions of (rows of a frame, missing rows, turns of the flicker from row to row), by name.
INTERPOLATIONS: dict[str, Callable[[int, int, float], Fill]] = {
    "neighbour_mean": neighbour_mean,
    "neighbour_rows": neighbour_rows,
    "linear": linear,
    "harmonic": harmonic,
    "none": none,
}
