"""Chi-squared statistics of a phase's wander: like a grid's, too little, or too much.

The phase is projected onto the principal directions in which a grid's phase deviates from a
constant frequency (:mod:`rsenf.flicker.grid_prior`), scaled to variance 1.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import FREE, NODE_S, phase_prior

Float = NDArray[np.float64]

# Sum of squares of a grid's first directions, each of mean 1, by their number: chi-squared is below
# that in 3e-4 of all grids.
DIRECTIONS = 4
STEADY = {3: 0.01, 4: 0.05}
MOVES = 0.05  # least mean square that counts as wander
# Chi-squared of 0 to 4 directions is above that in 4e-8 of all grids.
MAX_WANDER = (0.0, 30.2, 34.1, 37.3, 40.1)
KNOWN_VAR = 0.05  # largest variance of a known direction
# Certain wander: least number of known directions, least mean square, and least sum of squared
# z-scores. A quartz beside a lamp had a mean square of 0.13.
SURE_KNOWN, SURE_MOVES, SURE_SQUARES = 2, 0.25, 30.0


@dataclass(frozen=True, kw_only=True)
class Wander:
    """Wander of a phase about a constant frequency, in a grid's first principal directions.

    Attributes
    ----------
    known : int
        Number of directions that are known.
    squares : float
        Sum of their squares, each of mean 1 for a grid.
    squared_z : float
        Sum of the squares over the variance of each estimate, of mean 1 for a constant frequency.
    """

    known: int = 0
    squares: float = 0.0
    squared_z: float = 0.0

    @property
    def is_steady(self) -> bool:
        """Whether it wanders less than any grid."""
        return self.known in STEADY and self.squares < STEADY[self.known]

    @property
    def is_seen(self) -> bool:
        """Whether it is seen to wander."""
        return self.known > 0 and self.squares > MOVES * self.known

    @property
    def is_grids(self) -> bool:
        """Whether it certainly wanders, and as a grid does."""
        moves = self.known >= SURE_KNOWN and self.squares > SURE_MOVES * self.known
        return moves and self.squared_z > SURE_SQUARES and not self.is_restless

    @property
    def is_restless(self) -> bool:
        """Whether it wanders more than any grid."""
        return self.squares > MAX_WANDER[self.known]


def wander_of(coefficient: Float, precision: Float, nodes: int) -> Wander:
    """Wander of a smoothed phase about a constant frequency.

    Parameters
    ----------
    coefficient : ndarray, shape (directions,)
        In the basis of :func:`rsenf.flicker.grid_prior.phase_prior`.
    precision : ndarray, shape (directions, directions)
        Inverse covariance of the coefficients, the prior's included.
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
    """Map from coefficients to the first directions beside a line, (directions, coefficients)."""
    basis = phase_prior(nodes).basis
    t_s = NODE_S * (np.arange(nodes) - (nodes - 1) / 2.0)
    line, _ = np.linalg.qr(np.column_stack([np.ones(nodes), t_s]))
    beside = basis - line @ (line.T @ basis)
    left, size, _ = np.linalg.svd(beside[:, FREE:], full_matrices=False)
    count = min(DIRECTIONS, int(np.sum(size > 1e-6 * size[0])))
    return np.asarray((left[:, :count] / size[:count]).T @ beside)
