"""Null model of a live feed: any grid, as a bank of Kalman filters.

The frequency is as in :mod:`rsenf.flicker.grid_prior` (the sum of two Ornstein-Uhlenbeck processes,
passed twice through a first-order low-pass for inertia), plus an unknown constant that includes
the clock error. :func:`rsenf.match.ou_likelihood.generic_log_likelihood` is the same model for a
whole clip. States: phase, constant, the two processes, and the outputs of the two low-passes.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rsenf.flicker.grid_prior import INERTIA_S, WALKS
from rsenf.live.bank import Bank, Noise
from rsenf.live.noises import NOISES
from rsenf.match.clip_phase import RAD_PER_CYCLE
from rsenf.match.ou_likelihood import LIVELINESS, MEAN_STD_HZ
from rsenf.messages.schema import FloatArray

STATES = 6
_GRID = slice(2, None)  # the stationary states
SHARE = 1e-3
LONG_S = 5.0


class NullModel:
    """Filters of a phase under the null model, for several amplitudes of the grid's wander."""

    def __init__(self) -> None:
        models = [(lively, n, w * n.weight) for lively, w in LIVELINESS for n in NOISES]
        lively2 = np.array([lively**2 for lively, _, _ in models])
        spread = np.zeros((STATES, STATES))
        spread[_GRID, _GRID] = _stationary()
        spreads = lively2[:, None, None] * spread
        spreads[:, 1, 1] = MEAN_STD_HZ**2
        self._lively2 = lively2
        noise = Noise(
            np.array([n.ratio for _, n, _ in models]), np.array([n.floor_rad for _, n, _ in models])
        )
        self._bank = Bank(spreads, noise, np.array([w for _, _, w in models]), SHARE)

    def lose_phase(self) -> None:
        """Make the phase unknown."""
        self._bank.lose_phase()

    def take(self, passed_s: float, phase_rad: float, own_rad2: float) -> float:
        """Update with a phase ``passed_s`` after the last; return its log-likelihood.

        ``own_rad2`` is the variance of the phase.
        """
        turn, kick = _over(passed_s)
        self._bank.go_on(turn, self._lively2[:, None, None] * kick, 0.0)
        return self._bank.take(phase_rad, own_rad2)

    @property
    def was_out(self) -> bool:
        """Whether the last phase was an outlier for every grid."""
        return self._bank.was_out

    def phase_after(self, passed_s: float) -> tuple[float, float]:
        """Return the best filter's phase ``passed_s`` after the last one, and its variance."""
        best, (turn, kick) = self._bank.best, _over(passed_s)
        return self._bank.phase_after(best, turn, self._lively2[best] * kick)


def _drift() -> FloatArray:
    """Return the drift matrix of the continuous-time state-space model, per second."""
    a = np.zeros((STATES, STATES))
    a[0, 1] = a[0, 5] = RAD_PER_CYCLE
    a[2, 2], a[3, 3] = (-1.0 / memory_s for _, memory_s in WALKS)
    a[4, [2, 3, 4]] = np.array([1.0, 1.0, -1.0]) / INERTIA_S
    a[5, [4, 5]] = np.array([1.0, -1.0]) / INERTIA_S
    return a


@lru_cache(maxsize=256)
def _over(passed_s: float) -> tuple[FloatArray, FloatArray]:
    """Discretise the model: transition matrix and process noise over a time.

    Long times are composed of two halves: the block matrix contains the inertia backwards in time,
    whose exponential loses all precision after a minute.

    References
    ----------
    Van Loon, C. F. (1978), Computing integrals involving the matrix exponential, IEEE Trans.
    Automatic Control 23.
    """
    from scipy.linalg import expm

    if passed_s > LONG_S:
        turn, kick = _over(passed_s / 2.0)
        return turn @ turn, turn @ kick @ turn.T + kick
    a, kicks = _drift(), np.zeros((STATES, STATES))
    kicks[2, 2], kicks[3, 3] = (2.0 * std**2 / memory_s for std, memory_s in WALKS)
    block = np.zeros((2 * STATES, 2 * STATES))
    block[:STATES, :STATES] = -a
    block[:STATES, STATES:] = kicks
    block[STATES:, STATES:] = a.T
    found = expm(block * passed_s)
    turn = found[STATES:, STATES:].T
    return turn, turn @ found[:STATES, STATES:]


def _stationary() -> FloatArray:
    """Return the stationary covariance of the grid's states, by doubling the time step."""
    turn, spread = _over(1.0)
    turn, spread = turn[_GRID, _GRID], spread[_GRID, _GRID].copy()
    for _ in range(16):
        spread = turn @ spread @ turn.T + spread
        turn = turn @ turn
    return spread
