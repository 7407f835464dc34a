"""CUSUM of the evidence that a feed follows the grid now, and the two hypotheses behind it.

Model: *the feed follows the reference* (:class:`LagFilterBank`): there is one Kalman filter for
each possible lag of a live feed and each size of errors; the bank also estimates the lag and the
clock error. After subtraction of the reference's phase, a random walk (frequency errors of the
reference) and a drift (the clock error, itself a slow random walk) remain. *Any grid*
(:class:`NullModel`): the frequency is as in :mod:`rsenf.flicker.grid_prior` (the sum of two
Ornstein-Uhlenbeck processes, passed twice through a first-order low-pass for inertia), plus an
unknown constant that includes the clock error; as
:func:`rsenf.match.ou_likelihood.generic_log_likelihood` for a whole clip. States: phase, constant,
the two processes, and the outputs of the two low-passes.

Statistic: ``S ← min(max(S + log p(φ | reference) − log p(φ | any grid), least), most)`` of each
phase given those before. It is limited at both ends, so that the delay of detection doesn't depend
on how long the feed has been live or stale.

Approximate: lags in steps of 0.25 s, sizes of errors from a few; single loads and the inter-area
oscillation of the grid's prior are left out. Outliers of any grid don't count.

References
----------
Page, E. S. (1954), Continuous inspection schemes, Biometrika 41.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rsenf.flicker.grid_prior import INERTIA_S, WALKS
from rsenf.live.bank import NOISES, Bank, Noise
from rsenf.live.settings import LiveSettings
from rsenf.match.clip_phase import RAD_PER_CYCLE
from rsenf.match.ou_likelihood import LIVELINESS, MEAN_STD_HZ
from rsenf.messages.schema import FloatArray

STATES = 6
_GRID = slice(2, None)  # the stationary states
GRID_SHARE = 1e-3
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
        self.bank = Bank(spreads, noise, np.array([w for _, _, w in models]), GRID_SHARE)

    def update(self, passed_s: float, phase_rad: float, own_rad2: float) -> float:
        """Update with a phase ``passed_s`` after the last; return its log-likelihood.

        ``own_rad2`` is the variance of the phase.
        """
        transition, process_noise = _over(passed_s)
        self.bank.predict(transition, self._lively2[:, None, None] * process_noise, 0.0)
        return self.bank.update(phase_rad, own_rad2)

    def phase_after(self, passed_s: float) -> tuple[float, float]:
        """Return the best filter's phase ``passed_s`` after the last one, and its variance."""
        best, (transition, process_noise) = self.bank.best, _over(passed_s)
        return self.bank.phase_after(best, transition, self._lively2[best] * process_noise)


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
        transition, process_noise = _over(passed_s / 2.0)
        return transition @ transition, transition @ process_noise @ transition.T + process_noise
    a, kicks = _drift(), np.zeros((STATES, STATES))
    kicks[2, 2], kicks[3, 3] = (2.0 * std**2 / memory_s for std, memory_s in WALKS)
    block = np.zeros((2 * STATES, 2 * STATES))
    block[:STATES, :STATES] = -a
    block[:STATES, STATES:] = kicks
    block[STATES:, STATES:] = a.T
    found = expm(block * passed_s)
    transition = found[STATES:, STATES:].T
    return transition, transition @ found[:STATES, STATES:]


def _stationary() -> FloatArray:
    """Return the stationary covariance of the grid's states, by doubling the time step."""
    transition, spread = _over(1.0)
    transition, spread = transition[_GRID, _GRID], spread[_GRID, _GRID].copy()
    for _ in range(16):
        spread = transition @ spread @ transition.T + spread
        transition = transition @ transition
    return spread


LAG_STEP_S = 0.25
# Prior weights and standard deviations of the reference's error, of its mean over a second.
REFERENCE_HZ = ((0.7, 3e-4), (0.3, 1.5e-3))
CLOCK_PPM_PER_ROOT_S = 0.03  # a quartz that warms up drifts by some ppm in an hour
LAG_SHARE = 2e-3  # share of the weight returned to the prior with each phase: a lag may change


@dataclass(frozen=True)
class LagEstimate:
    """Estimated lag and clock error with standard errors; NaN before the first phase."""

    lag_s: float = math.nan
    lag_std_s: float = math.nan
    clock_ppm: float = math.nan
    clock_std_ppm: float = math.nan


class LagFilterBank:
    """Filters of a phase that follows the reference; states: phase, frequency offset (Hz).

    Parameters
    ----------
    settings : LiveSettings
    nominal_hz : float
        Nominal frequency of the grid.

    Attributes
    ----------
    lag_s : ndarray, shape (lags,)
    """

    def __init__(self, settings: LiveSettings, nominal_hz: float) -> None:
        steps = round((settings.latest_s - settings.earliest_s) / LAG_STEP_S)
        self.lag_s = np.asarray(settings.earliest_s + LAG_STEP_S * np.arange(steps + 1), np.float64)
        sizes = [(n, hz, n.weight * share) for n in NOISES for share, hz in REFERENCE_HZ]
        noise = Noise(
            self._at_each_lag([n.ratio for n, _, _ in sizes]),
            self._at_each_lag([n.floor_rad for n, _, _ in sizes]),
        )
        self._hz_per_ppm = 1e-6 * nominal_hz
        walk_rad2 = self._at_each_lag([(RAD_PER_CYCLE * hz) ** 2 for _, hz, _ in sizes])
        self._process_noise_per_s = np.zeros((walk_rad2.size, 2, 2))
        self._process_noise_per_s[:, 0, 0] = walk_rad2
        self._process_noise_per_s[:, 1, 1] = (CLOCK_PPM_PER_ROOT_S * self._hz_per_ppm) ** 2
        spread = np.zeros_like(self._process_noise_per_s)
        spread[:, 1, 1] = (settings.clock_scale_ppm * self._hz_per_ppm) ** 2
        self.bank = Bank(spread, noise, self._at_each_lag([w for _, _, w in sizes]), LAG_SHARE)
        self._taken = 0

    def _at_each_lag(self, values: list[float]) -> FloatArray:
        return np.repeat(np.array(values), self.lag_s.size)

    def update(
        self, passed_s: float, phase_rad: float, own_rad2: float, moved_rad: FloatArray
    ) -> float:
        """Update with a phase; return its log-likelihood.

        Parameters
        ----------
        passed_s : float
            Time since the last phase.
        phase_rad, own_rad2 : float
            The phase and its variance.
        moved_rad : ndarray, shape (lags,)
            Change of the reference's phase in between, for each lag.
        """
        transition = np.array([[1.0, RAD_PER_CYCLE * passed_s], [0.0, 1.0]])
        moved = np.tile(moved_rad, len(self._process_noise_per_s) // self.lag_s.size)
        self.bank.predict(transition, passed_s * self._process_noise_per_s, moved)
        self._taken += 1
        return self.bank.update(phase_rad, own_rad2)

    @property
    def course(self) -> LagEstimate:
        """Posterior mean and standard deviation of lag and clock error."""
        if not self._taken:
            return LagEstimate()
        by_lag = self.bank.weight.reshape(-1, self.lag_s.size).sum(axis=0)
        lag_s = float(by_lag @ self.lag_s)
        var_s2 = float(by_lag @ (self.lag_s - lag_s) ** 2) + LAG_STEP_S**2 / 12.0
        offset_hz, var_hz2 = self.bank.expected(1)
        return LagEstimate(
            lag_s,
            math.sqrt(var_s2),
            -offset_hz / self._hz_per_ppm,
            math.sqrt(var_hz2) / self._hz_per_ppm,
        )


LONGEST_S = 60.0  # gap after which the phase counts as unknown
WILD, SEEN = 5, 20  # more than WILD outliers among the last SEEN phases are too many


@dataclass(frozen=True)
class Phase:
    """A measured phase (rad), its variance, and its time on the stream's clock."""

    t_ns: int
    rad: float
    var_rad2: float


class Cusum:
    """The CUSUM of one epoch of one camera.

    Parameters
    ----------
    settings : LiveSettings
    nominal_hz : float

    Attributes
    ----------
    nats : float
        The sum; positive for a live feed.
    last : Phase or None
        The last phase taken.
    """

    def __init__(self, settings: LiveSettings, nominal_hz: float) -> None:
        self._limits = settings.limits
        self.follows, self.any_grid = LagFilterBank(settings, nominal_hz), NullModel()
        self.nats = 0.0
        self.last: Phase | None = None
        self._out: deque[bool] = deque(maxlen=SEEN)

    def update(self, phase: Phase, moved_rad: FloatArray | None) -> None:
        """Take a phase, and add its evidence to the sums (Page 1954).

        Parameters
        ----------
        phase : Phase
        moved_rad : ndarray, shape (lags,), or None
            Change of the reference's phase since the last one, for each lag; None if unknown.
        """
        passed_s = (phase.t_ns - self.last.t_ns) / 1e9 if self.last else 0.0
        if passed_s > LONGEST_S:
            self.any_grid.bank.lose_phase()
            self.nats = 0.0  # the feed may show something else after the gap
        if moved_rad is None or passed_s > LONGEST_S:
            self.follows.bank.lose_phase()
        moved = np.zeros(self.follows.lag_s.size) if moved_rad is None else moved_rad
        by_reference = self.follows.update(passed_s, phase.rad, phase.var_rad2, moved)
        by_any = self.any_grid.update(passed_s, phase.rad, phase.var_rad2)
        if moved_rad is not None and 0.0 < passed_s <= LONGEST_S:
            self._weigh(by_reference - by_any)
        self.last = phase

    def _weigh(self, nats: float) -> None:
        """Add a log-likelihood ratio, unless the phase is an outlier for every grid."""
        self._out.append(self.any_grid.bank.was_outlier)
        if self.is_wild:
            self.nats = 0.0
        elif not self.any_grid.bank.was_outlier:
            now = self.nats + nats
            self.nats = min(max(now, self._limits.least), self._limits.most)

    @property
    def is_wild(self) -> bool:
        """Whether so many recent phases are outliers that they can't be those of a grid."""
        return sum(self._out) > WILD
