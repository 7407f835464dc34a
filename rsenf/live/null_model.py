"""Null model of a live feed: any grid, as a Kalman filter; the alternative to the reference.

The frequency is that of :mod:`rsenf.flicker.grid_prior` (two Ornstein–Uhlenbeck processes,
smoothed twice by inertia) about a mean that isn't known, for the clock's error is in
it. :func:`rsenf.match.ou_likelihood.generic_log_likelihood` says the same of a whole clip at once.
States: phase, mean, the two walks, and the frequency after one and after two passes through the
inertia.
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
_GRID = slice(2, None)  # the states of the grid itself
SHARE = 1e-3
LONG_S = 5.0


class NullModel:
    """Follows a phase by what grids do."""

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
        """Forget the phase."""
        self._bank.lose_phase()

    def take(self, passed_s: float, phase_rad: float, own_rad2: float) -> float:
        """Take the phase some seconds after the last; return its log-likelihood."""
        turn, kick = _over(passed_s)
        self._bank.go_on(turn, self._lively2[:, None, None] * kick, 0.0)
        return self._bank.take(phase_rad, own_rad2)

    @property
    def was_out(self) -> bool:
        """Whether no grid does what the last phase did."""
        return self._bank.was_out

    def phase_after(self, passed_s: float) -> tuple[float, float]:
        """Phase foretold for some seconds after the last, by the best filter, and its variance."""
        best, (turn, kick) = self._bank.best, _over(passed_s)
        return self._bank.phase_after(best, turn, self._lively2[best] * kick)


def _drift() -> FloatArray:
    """How the states move, per second."""
    a = np.zeros((STATES, STATES))
    a[0, 1] = a[0, 5] = RAD_PER_CYCLE
    a[2, 2], a[3, 3] = (-1.0 / memory_s for _, memory_s in WALKS)
    a[4, [2, 3, 4]] = np.array([1.0, 1.0, -1.0]) / INERTIA_S
    a[5, [4, 5]] = np.array([1.0, -1.0]) / INERTIA_S
    return a


@lru_cache(maxsize=256)
def _over(passed_s: float) -> tuple[FloatArray, FloatArray]:
    """Transition and covariance of the kicks over a time.

    Long ones are made of two halves: the exponential holds what inertia does backwards in time,
    which after a minute is beyond any number of digits.

    C. F. Van Loon, "Computing integrals involving the matrix exponential", IEEE Trans. Automatic
    Control 23, 1978.
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
    """Covariance of the grid's own states in the long run, by doubling the time."""
    turn, spread = _over(1.0)
    turn, spread = turn[_GRID, _GRID], spread[_GRID, _GRID].copy()
    for _ in range(16):
        spread = turn @ spread @ turn.T + spread
        turn = turn @ turn
    return spread
