"""Bank of Kalman filters that track one phase (Bayesian model averaging).

Model: all filters have the same linear Gaussian states, the first of which is the phase. They
differ in process noise, in measurement noise (:data:`NOISES` is its prior), and in the known input
to the phase.

Likelihood: ``(1 − ε)·WN(innovation; variance) + ε/2π``, a wrapped normal mixed with a uniform
density for outliers (a lost frame, a splice), which is the same in all filters and therefore
doesn't favour any. Weights follow Bayes' rule and the fixed-share rule.

Approximate: the update uses only the innovation wrapped to half a turn, and the density three
terms. After an outlier the phase begins anew at its measurement.

References
----------
- Magill, D. T. (1965), Optimal adaptive estimation of sampled stochastic processes, IEEE Trans.
  Automatic Control 10.
- Herbster, M. and Warmuth, M. K. (1998), Tracking the best expert, Machine Learning 32.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rsenf.messages.schema import FloatArray

OUTLIER_PROBABILITY = 1e-3  # prior probability of an outlier
UNKNOWN_RAD2 = 1e3  # variance of an unknown phase
UNIFORM_RAD2 = 10.0  # a wrapped normal of a larger variance is taken as uniform
TURN_RAD = 2.0 * math.pi
_TURNS = TURN_RAD * np.arange(-1, 2)


@dataclass(frozen=True, eq=False)
class Noise:
    """Measurement noise of each of n filters: ``ratio`` (n,) times the estimate's standard error,
    and in addition ``floor_rad`` (n,) for errors that the standard error doesn't include.
    """

    ratio: FloatArray
    floor_rad: FloatArray

    def var_rad2(self, own_rad2: float) -> FloatArray:
        """Return the variance of a measured phase in each filter, shape (n,)."""
        return np.asarray(self.ratio**2 * own_rad2 + self.floor_rad**2, np.float64)


class Bank:
    """A bank of n filters with d states.

    Parameters
    ----------
    spread : ndarray, shape (n, d, d)
        Initial covariance of the states, whose means are 0. The phase is set to unknown.
    noise : Noise
    weight : ndarray, shape (n,)
        Prior weights of the filters.
    share : float
        Share of the weight that returns to the prior with each phase: the best filter may change.

    Attributes
    ----------
    mean, cov : ndarray, shapes (n, d) and (n, d, d)
    weight : ndarray, shape (n,)
        Posterior weights.
    was_outlier : bool
        Whether the last phase was an outlier (posterior probability over 0.5).
    """

    def __init__(self, spread: FloatArray, noise: Noise, weight: FloatArray, share: float) -> None:
        self.mean = np.zeros(spread.shape[:2])
        self.cov = spread.copy()
        self._noise, self._share = noise, share
        self._prior = weight / weight.sum()
        self.weight = self._prior.copy()
        self.was_outlier = False
        self.lose_phase()

    def lose_phase(self) -> None:
        """Make the phase unknown, but keep the other states."""
        self.cov[:, 0, :] = 0.0
        self.cov[:, :, 0] = 0.0
        self.cov[:, 0, 0] = UNKNOWN_RAD2

    def predict(
        self, transition: FloatArray, process_noise: FloatArray, moved_rad: FloatArray | float
    ) -> None:
        """Predict: transition matrix, process noise, and known change of the phase (Kalman 1960).

        Parameters
        ----------
        transition : ndarray, shape (d, d)
        process_noise : ndarray, shape (n, d, d)
        moved_rad : ndarray, shape (n,), or float
        """
        self.mean = self.mean @ transition.T
        self.mean[:, 0] += moved_rad
        self.cov = transition @ self.cov @ transition.T + process_noise
        # Limit the phase's variance to that of an unknown phase. Its covariances are scaled too, or
        # the covariance matrix would no longer be positive definite and the filters would diverge.
        if self.cov[:, 0, 0].max() > UNKNOWN_RAD2:
            shrunk = np.sqrt(np.minimum(UNKNOWN_RAD2 / self.cov[:, 0, 0], 1.0))[:, None]
            self.cov[:, 0, :] *= shrunk
            self.cov[:, :, 0] *= shrunk

    def update(self, phase_rad: float, own_rad2: float) -> float:
        """Update with a measured phase; return its predictive log-likelihood, nats (Magill 1965).

        Parameters
        ----------
        phase_rad : float
            Modulo whole turns.
        own_rad2 : float
            The estimate's variance.
        """
        noise = self._noise.var_rad2(own_rad2)
        spread = self.cov[:, 0, 0] + noise
        away = _wrapped(phase_rad - self.mean[:, 0])
        inside = _wrapped_normal(away, spread) + math.log1p(-OUTLIER_PROBABILITY)
        outside = math.log(OUTLIER_PROBABILITY / TURN_RAD)
        likelihood = np.logaddexp(inside, outside)
        joint = np.log(self.weight) + likelihood
        total = float(np.logaddexp.reduce(joint))
        lost = outside > inside
        # Outlier, or uniform prediction: restart the phase at its measurement, keep other states.
        anew = lost | (spread > UNIFORM_RAD2)
        gain = self.cov[:, :, 0] / spread[:, None]
        learnt = gain[:, :, None] * self.cov[:, None, 0, :]
        gain *= away[:, None]
        if anew.any():
            gain[anew], learnt[anew] = 0.0, 0.0
        self.mean += gain
        self.cov -= learnt
        if anew.any():
            self.mean[anew, 0] = phase_rad
            self.cov[anew, 0, :] = self.cov[anew, :, 0] = 0.0
            self.cov[anew, 0, 0] = noise[anew]
        weight = np.exp(joint - total)
        self.was_outlier = bool(weight @ lost > 0.5)
        self.weight = (1.0 - self._share) * weight + self._share * self._prior
        return total

    def expected(self, state: int) -> tuple[float, float]:
        """Return a state's posterior mean and variance, averaged over the filters."""
        own, var = self.mean[:, state], self.cov[:, state, state]
        mean = float(self.weight @ own)
        return mean, float(self.weight @ (var + (own - mean) ** 2))

    @property
    def best(self) -> int:
        """Index of the filter with the largest weight."""
        return int(self.weight.argmax())

    def phase_after(
        self, one: int, transition: FloatArray, process_noise: FloatArray
    ) -> tuple[float, float]:
        """Return the phase predicted by filter ``one``, and its variance.

        Both (d, d) are those until then.
        """
        ahead = transition @ self.cov[one] @ transition.T + process_noise
        return float((transition @ self.mean[one])[0]), float(ahead[0, 0])


def _wrapped(away_rad: FloatArray) -> FloatArray:
    """Wrap phase differences to within half a turn."""
    return np.asarray(away_rad - TURN_RAD * np.rint(away_rad / TURN_RAD), np.float64)


def _wrapped_normal(away_rad: FloatArray, var_rad2: FloatArray) -> FloatArray:
    """Log density of a wrapped normal distribution, by three terms."""
    var = np.minimum(var_rad2, UNIFORM_RAD2)
    square = (away_rad[:, None] + _TURNS) ** 2 / var[:, None]
    level = -0.5 * np.log(TURN_RAD * var)
    return np.asarray(np.logaddexp.reduce(-0.5 * square, axis=1) + level, np.float64)


@dataclass(frozen=True)
class PhaseNoise:
    """One noise model, with its prior weight: ``ratio`` times the standard error, plus a floor.

    Codecs at low bit rates make the phase wander by 0.02 to 0.15 rad over some seconds.
    """

    weight: float
    ratio: float
    floor_rad: float


# No estimate counts as better than the first floor: a tracker's errors are correlated from second
# to second, and taking them as independent makes the test overconfident.
NOISES = (PhaseNoise(0.6, 1.0, 0.03), PhaseNoise(0.3, 2.0, 0.06), PhaseNoise(0.1, 2.0, 0.15))
