"""Kalman filters side by side that follow one phase, each under its own assumptions.

All have the same states, of which the first is the phase; they differ in how much they are kicked,
in how noisy they take the measurement to be, and in how far they expect the phase to move. A phase
is known up to whole turns. Now and then one is out of the way altogether (a lost frame, a splice):
under every assumption alike, so that it tells neither for nor against any.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rsenf.messages.schema import FloatArray

OUT_OF_THE_WAY = 1e-3  # share of seconds whose phase has nothing to do with those before
UNKNOWN_RAD2 = 1e3  # variance of a phase that isn't known; nothing is learnt from it
UNIFORM_RAD2 = 10.0  # a wrapped normal wider than this is uniform
TURN_RAD = 2.0 * math.pi
_TURNS = TURN_RAD * np.arange(-1, 2)


@dataclass(frozen=True, eq=False)
class Noise:
    """How noisy each of n filters takes a phase to be: (n,) its own error times ``ratio``, and
    ``floor_rad`` besides, for what no estimate's own error counts.
    """

    ratio: FloatArray
    floor_rad: FloatArray

    def var_rad2(self, own_rad2: float) -> FloatArray:
        """Variance of a measured phase, (n,)."""
        return np.asarray(self.ratio**2 * own_rad2 + self.floor_rad**2, np.float64)


class Bank:
    """The filters.

    Parameters
    ----------
    spread : ndarray, shape (n, d, d)
        Covariance of the states to begin with; they are all 0. The phase is taken as unknown.
    noise : Noise
    weight : ndarray, shape (n,)
        Prior weights of the filters.
    share : float
        Of the weight, that goes back to the prior with each phase: the best one may change.

    Attributes
    ----------
    was_out : bool
        Whether the last phase was out of the way.
    """

    def __init__(self, spread: FloatArray, noise: Noise, weight: FloatArray, share: float) -> None:
        self.mean = np.zeros(spread.shape[:2])
        self.cov = spread.copy()
        self._noise, self._share = noise, share
        self._prior = weight / weight.sum()
        self.weight = self._prior.copy()
        self.was_out = False
        self.lose_phase()

    def lose_phase(self) -> None:
        """Forget the phase, but not the other states."""
        self.cov[:, 0, :] = 0.0
        self.cov[:, :, 0] = 0.0
        self.cov[:, 0, 0] = UNKNOWN_RAD2

    def go_on(self, turn: FloatArray, kick: FloatArray, moved_rad: FloatArray | float) -> None:
        """Go on in time: ``turn`` (d, d) and ``kick`` (n, d, d), and by what the phase moves."""
        self.mean = self.mean @ turn.T
        self.mean[:, 0] += moved_rad
        self.cov = turn @ self.cov @ turn.T + kick
        # The phase can't be less known than not at all. What it has in common with the other states
        # shrinks with it: a covariance that doesn't hold together makes the filters run away.
        if self.cov[:, 0, 0].max() > UNKNOWN_RAD2:
            shrunk = np.sqrt(np.minimum(UNKNOWN_RAD2 / self.cov[:, 0, 0], 1.0))[:, None]
            self.cov[:, 0, :] *= shrunk
            self.cov[:, :, 0] *= shrunk

    def take(self, phase_rad: float, own_rad2: float) -> float:
        """Take a phase in; return its log-likelihood given those before (nats)."""
        noise = self._noise.var_rad2(own_rad2)
        spread = self.cov[:, 0, 0] + noise
        away = _wrapped(phase_rad - self.mean[:, 0])
        inside = _wrapped_normal(away, spread) + math.log1p(-OUT_OF_THE_WAY)
        outside = math.log(OUT_OF_THE_WAY / TURN_RAD)
        told = np.logaddexp(inside, outside)
        joint = np.log(self.weight) + told
        total = float(np.logaddexp.reduce(joint))
        lost = outside > inside
        # A phase that might be any, by what was foretold, tells nothing but itself.
        anew = lost | (spread > UNIFORM_RAD2)
        gain = self.cov[:, :, 0] / spread[:, None]
        learnt = gain[:, :, None] * self.cov[:, None, 0, :]
        gain *= away[:, None]
        if anew.any():
            gain[anew], learnt[anew] = 0.0, 0.0
        self.mean += gain
        self.cov -= learnt
        if anew.any():
            self._restart(anew, phase_rad, noise)
        weight = np.exp(joint - total)
        self.was_out = bool(weight @ lost > 0.5)
        self.weight = (1.0 - self._share) * weight + self._share * self._prior
        return total

    def _restart(self, lost: np.ndarray, phase_rad: float, noise: FloatArray) -> None:
        """Begin anew, with the phase as it was measured, what is ``lost``."""
        self.mean[lost, 0] = phase_rad
        self.cov[lost, 0, :] = 0.0
        self.cov[lost, :, 0] = 0.0
        self.cov[lost, 0, 0] = noise[lost]

    def expected(self, state: int) -> tuple[float, float]:
        """Mean and variance of a state, over all filters by their weights."""
        own, var = self.mean[:, state], self.cov[:, state, state]
        mean = float(self.weight @ own)
        return mean, float(self.weight @ (var + (own - mean) ** 2))

    @property
    def best(self) -> int:
        """Which filter has most weight."""
        return int(self.weight.argmax())

    def phase_after(self, one: int, turn: FloatArray, kick: FloatArray) -> tuple[float, float]:
        """Phase foretold by one filter, a while on, and its variance."""
        ahead = turn @ self.cov[one] @ turn.T + kick
        return float((turn @ self.mean[one])[0]), float(ahead[0, 0])


def _wrapped(away_rad: FloatArray) -> FloatArray:
    """Bring differences of phases to within half a turn."""
    return np.asarray(away_rad - TURN_RAD * np.rint(away_rad / TURN_RAD), np.float64)


def _wrapped_normal(away_rad: FloatArray, var_rad2: FloatArray) -> FloatArray:
    """Log density of a normal wound round the circle."""
    var = np.minimum(var_rad2, UNIFORM_RAD2)
    square = (away_rad[:, None] + _TURNS) ** 2 / var[:, None]
    level = -0.5 * np.log(TURN_RAD * var)
    return np.asarray(np.logaddexp.reduce(-0.5 * square, axis=1) + level, np.float64)
