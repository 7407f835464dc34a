"""Gaussian-process prior of a grid's frequency over half a minute.

Model: the frequency is a sum of Ornstein-Uhlenbeck processes: the slow balance of generation and
load and the fast primary control, both low-pass filtered twice by the inertia of rotating machines;
single loads, unfiltered; and the inter-area oscillation of one end of the grid against the other,
damped. The mean deviation from the nominal frequency is free.

Statistic: :class:`Wander` tests whether a phase wanders like a grid's, too little or too much: it
is projected onto the principal directions in which a grid's phase deviates from a constant
frequency, scaled to variance 1, and the sum of squares is chi-squared.

Approximate: it is fitted to the spectrum from 0.006 to 0.5 Hz of half a measured day of continental
Europe (17 September 2022), and holds in the other half; other grids and days are livelier or
quieter. Changes over 1, 10, 60 and 300 s are 1.3, 7.5, 13 and 21 mHz rms.

References
----------
- Uhlenbeck, G. E. and Ornstein, L. S. (1930), On the theory of the Brownian motion, Physical
  Review 36, 823.
- Rasmussen, C. E. and Williams, C. K. I. (2006), Gaussian Processes for Machine Learning.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

NODE_S = 0.25  # between the nodes of the phase
NODES_PER_S = round(1.0 / NODE_S)
# Model error (Hz): the phase is linear between nodes, a real grid's isn't quite.
MODEL_STD_HZ = 4e-5
# Grid frequency: standard deviation (Hz) and correlation time (s) of each process; inertia (s).
WALKS = ((0.0175, 370.0), (0.008, 9.1))
INERTIA_S = 2.35
LOADS = (0.001, 10.0)
SWING, SWING_HZ = (0.00055, 8.6), 0.2
# Number of free directions: phase, and mean deviation of the illumination frequency.
FREE = 2
MEAN_STD_HZ = 0.5
PHASE_STD_RAD = 10.0
# Directions in which the phase has a smaller standard deviation (rad) are left out.
NEGLIGIBLE_RAD = 2e-4
_LAGS = 1 << 15


@lru_cache(maxsize=1)
def _autocovariance() -> Float:
    """Autocovariance (Hz²) of the illumination frequency, averaged from node to node."""
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(_LAGS, NODE_S), np.float64)
    spectrum = _spectrum(omega, *WALKS[0]) + _spectrum(omega, *WALKS[1])
    spectrum = spectrum / (1.0 + (omega * INERTIA_S) ** 2) ** 2 + _spectrum(omega, *LOADS)
    for side_hz in (-SWING_HZ, SWING_HZ):
        spectrum = spectrum + 0.5 * _spectrum(omega - 2.0 * np.pi * side_hz, *SWING)
    return np.asarray(np.fft.irfft(4.0 * spectrum) / NODE_S, np.float64)


def _spectrum(omega: Float, std_hz: float, memory_s: float) -> Float:
    """Two-sided power spectral density of an Ornstein-Uhlenbeck process."""
    return np.asarray(std_hz**2 * 2.0 * memory_s / (1.0 + (omega * memory_s) ** 2))


def wander_rad2(t_s: Float) -> Float:
    """Mean square wander of the phase after some time, rad² (Uhlenbeck and Ornstein 1930).

    Parameters
    ----------
    t_s : ndarray
        Whole multiples of :data:`NODE_S`.

    Examples
    --------
    >>> np.sqrt(wander_rad2(np.array([1.0, 10.0]))).round(2).tolist()
    [0.24, 2.33]
    """
    # Var(Σ_1^k f) = Σ_{i,j} r(i − j): its second difference is twice the autocovariance, which
    # vanishes within an hour.
    r = _autocovariance()[: _LAGS // 2]
    nodes = np.rint(np.asarray(t_s) / NODE_S).astype(np.int64)
    bend = np.zeros(max(r.size, int(nodes.max(initial=0))) + 1)
    bend[1], bend[2 : r.size + 1] = r[0], 2.0 * r[1:]
    spread = (2.0 * np.pi * NODE_S) ** 2 * np.cumsum(np.cumsum(bend))
    return np.asarray(spread[nodes], np.float64)


@dataclass(frozen=True, eq=False)
class PhasePrior:
    """Prior of the phase at equidistant nodes: ``basis @ a``, with independent ``a`` of variance 1.

    Attributes
    ----------
    basis : ndarray, shape (nodes, directions)
    left_out_hz2 : ndarray, shape (nodes − 4,)
        Variance of the mean frequency over the second that begins at each node, due to the
        directions left out.
    """

    basis: Float
    left_out_hz2: Float

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return int(self.basis.shape[0])

    def nearest(self, psi_rad: Float) -> Float:
        """Coefficients ``a`` of the path nearest to a phase at the nodes (least squares)."""
        left, size, right = self._parts
        return np.asarray(((left.T @ psi_rad) / size) @ right)

    def precision(self, information: Float) -> Float:
        """Posterior precision of the coefficients, given each node's Fisher information."""
        precision = self.basis.T @ (information[:, None] * self.basis)
        precision.flat[:: len(precision) + 1] += 1.0
        return precision

    def second_var_hz2(self, covariance: Float) -> Float:
        """Variance of the mean frequency over the second that begins at each node.

        Parameters
        ----------
        covariance : ndarray, shape (directions, directions)
            Of the coefficients.

        Returns
        -------
        ndarray, shape (nodes − 4,)
        """
        over_second = _over_seconds(self.basis)
        known = np.sum((over_second @ covariance) * over_second, axis=1)
        return np.asarray(known + self.left_out_hz2)

    @cached_property
    def _parts(self) -> tuple[Float, Float, Float]:
        """Singular value decomposition of the basis."""
        left, size, right = np.linalg.svd(self.basis, full_matrices=False)
        return left, size, right


@lru_cache(maxsize=128)
def phase_prior(nodes: int) -> PhasePrior:
    """Return the prior of the phase at equidistant nodes, relative to the nominal frequency's.

    Karhunen-Loève expansion of the integrated frequency; free phase and mean frequency come first.
    """
    steps = nodes - 1
    lag = np.abs(np.subtract.outer(np.arange(steps), np.arange(steps)))
    covariance = _autocovariance()[lag]
    # Integrate from the middle node outwards, so that no direction is large at one end only.
    middle = steps // 2
    to_node = np.tri(nodes, steps, -1)
    to_node = 2.0 * np.pi * NODE_S * (to_node - to_node[middle])
    spread = to_node @ covariance @ to_node.T
    value, vector = np.linalg.eigh(spread)
    kept = value > NEGLIGIBLE_RAD**2
    moves = vector[:, kept] * np.sqrt(value[kept])
    left_out = vector[:, ~kept] * np.sqrt(np.maximum(value[~kept], 0.0))
    t_s = NODE_S * (np.arange(nodes) - middle)
    free = np.column_stack([np.full(nodes, PHASE_STD_RAD), 2.0 * np.pi * MEAN_STD_HZ * t_s])
    return PhasePrior(
        np.column_stack([free, moves[:, ::-1]]), np.sum(_over_seconds(left_out) ** 2, axis=1)
    )


def _over_seconds(psi_rad: Float) -> Float:
    """Mean frequencies over the second that begins at each node, shape (nodes − 4, …)."""
    return (psi_rad[NODES_PER_S:] - psi_rad[:-NODES_PER_S]) / (2.0 * np.pi)


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
