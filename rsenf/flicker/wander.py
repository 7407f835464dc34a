"""How a phase strays from a steady course: as a grid's does, too little, or too much."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import FREE, NODE_S, phase_prior

Float = NDArray[np.float64]

# Sums of squares of the first directions in which a grid's phase strays from a steady course, each
# of mean 1: chi-squared is less than that in 3e-4 of all grids, and more, by far, in none.
DIRECTIONS = 4
STEADY = {3: 0.01, 4: 0.05}
MOVES = 0.05  # on average: what is seen to move
# Chi-squared is more than that, a sum of 1 to 4 of them, in 4e-8 of all grids.
MAX_WANDER = (0.0, 30.2, 34.1, 37.3, 40.1)
KNOWN_VAR = 0.05  # variance of a direction that is known
# What surely moves as a grid does: in so many directions, so much on average, and with so large a
# sum of squares of its own error. A quartz beside a lamp moved by 0.13 on average.
SURE_KNOWN, SURE_MOVES, SURE_SQUARES = 2, 0.25, 30.0


@dataclass(frozen=True, kw_only=True)
class Wander:
    """How a phase strays from a steady course, by a grid's first directions.

    Attributes
    ----------
    known : int
        In how many directions it is known.
    squares : float
        Sum of their squares, each of which has the mean 1 for a grid.
    squared_z : float
        The same over the variance with which each is known: it has the mean 1 for what rests.
    """

    known: int = 0
    squares: float = 0.0
    squared_z: float = 0.0

    @property
    def is_steady(self) -> bool:
        """Whether it rests, as no grid does."""
        return self.known in STEADY and self.squares < STEADY[self.known]

    @property
    def is_seen(self) -> bool:
        """Whether it is seen to move."""
        return self.known > 0 and self.squares > MOVES * self.known

    @property
    def is_grids(self) -> bool:
        """Whether it surely moves, and as a grid's does."""
        moves = self.known >= SURE_KNOWN and self.squares > SURE_MOVES * self.known
        return moves and self.squared_z > SURE_SQUARES and not self.is_restless

    @property
    def is_restless(self) -> bool:
        """Whether it strays as no grid does."""
        return self.squares > MAX_WANDER[self.known]


def wander_of(coefficient: Float, precision: Float, nodes: int) -> Wander:
    """How a smoothed phase strays from a steady course.

    Parameters
    ----------
    coefficient : ndarray, shape (directions,)
        Of the basis of :func:`rsenf.flicker.grid_prior.phase_prior`.
    precision : ndarray, shape (directions, directions)
        Inverse of their covariance, the prior's included.
    nodes : int
    """
    strays = _strays(nodes)
    variance = np.einsum("ij,ji->i", strays, np.linalg.solve(precision, strays.T))
    known = int(np.argmax(np.append(variance > KNOWN_VAR, True)))  # those before the first unknown
    squares = (strays[:known] @ coefficient) ** 2
    return Wander(
        known=known,
        squares=float(squares.sum()),
        squared_z=float(np.sum(squares / variance[:known])),
    )


@functools.lru_cache(maxsize=128)
def _strays(nodes: int) -> Float:
    """From coefficients to the first directions beside a line, shape (directions, coefficients)."""
    basis = phase_prior(nodes).basis
    t_s = NODE_S * (np.arange(nodes) - (nodes - 1) / 2.0)
    line, _ = np.linalg.qr(np.column_stack([np.ones(nodes), t_s]))
    beside = basis - line @ (line.T @ basis)
    left, size, _ = np.linalg.svd(beside[:, FREE:], full_matrices=False)
    count = min(DIRECTIONS, int(np.sum(size > 1e-6 * size[0])))
    return np.asarray((left[:, :count] / size[:count]).T @ beside)
