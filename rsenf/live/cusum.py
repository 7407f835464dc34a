"""CUSUM of the evidence that a feed follows the grid now, and the lag filter bank that feeds it.

Each phase tells how much likelier it is by the reference than by any grid whatever; these
log-likelihood ratios are added up. The sum stops at both ends, so that a change is seen as fast
after a day as after a minute: E. S. Page, "Continuous inspection schemes", Biometrika 41, 1954.

The bank has one Kalman filter for each lag that an honest feed may have and each size of the
errors; it tells the lag and the clock's error as well. What is left of
the phase when the reference's has been taken away is a walk, for the reference's errors are in its
frequency, and a steady drift, the clock's error, which changes by little.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from rsenf.live.bank import Bank, Noise
from rsenf.live.noises import NOISES
from rsenf.live.null_model import NullModel
from rsenf.live.settings import LiveSettings
from rsenf.match.clip_phase import RAD_PER_CYCLE
from rsenf.messages.schema import FloatArray

LAG_STEP_S = 0.25
REFERENCE_HZ = ((0.7, 3e-4), (0.3, 1.5e-3))  # of its mean over a second, by share
CLOCK_PPM_PER_ROOT_S = 0.03  # warming up, a quartz wanders by some ppm in an hour
SHARE = 2e-3  # of the lags' weight that is shared out anew each second: a lag may change


@dataclass(frozen=True)
class Course:
    """Where the best filters stand; NaN before there is anything to go by."""

    lag_s: float = math.nan
    lag_std_s: float = math.nan
    clock_ppm: float = math.nan
    clock_std_ppm: float = math.nan


class LagFilterBank:
    """Follows a phase by the reference.

    Parameters
    ----------
    settings : LiveSettings
    nominal_hz : float
        Of the grid.
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
        self._kick_per_s = np.zeros((walk_rad2.size, 2, 2))
        self._kick_per_s[:, 0, 0] = walk_rad2
        self._kick_per_s[:, 1, 1] = (CLOCK_PPM_PER_ROOT_S * self._hz_per_ppm) ** 2
        spread = np.zeros_like(self._kick_per_s)
        spread[:, 1, 1] = (settings.clock_scale_ppm * self._hz_per_ppm) ** 2
        self._bank = Bank(spread, noise, self._at_each_lag([w for _, _, w in sizes]), SHARE)
        self._taken = 0

    def _at_each_lag(self, values: list[float]) -> FloatArray:
        return np.repeat(np.array(values), self.lag_s.size)

    def lose_phase(self) -> None:
        """Forget the phase."""
        self._bank.lose_phase()

    def take(
        self, passed_s: float, phase_rad: float, own_rad2: float, moved_rad: FloatArray
    ) -> float:
        """Take the phase some seconds after the last; return its log-likelihood.

        ``moved_rad`` (lags,) is how far the reference's phase went in between, at each lag.
        """
        turn = np.array([[1.0, RAD_PER_CYCLE * passed_s], [0.0, 1.0]])
        moved = np.tile(moved_rad, len(self._kick_per_s) // self.lag_s.size)
        self._bank.go_on(turn, passed_s * self._kick_per_s, moved)
        self._taken += 1
        return self._bank.take(phase_rad, own_rad2)

    @property
    def course(self) -> Course:
        """Lag and clock, over all filters by their weights."""
        if not self._taken:
            return Course()
        by_lag = self._bank.weight.reshape(-1, self.lag_s.size).sum(axis=0)
        lag_s = float(by_lag @ self.lag_s)
        var_s2 = float(by_lag @ (self.lag_s - lag_s) ** 2) + LAG_STEP_S**2 / 12.0
        offset_hz, var_hz2 = self._bank.expected(1)
        return Course(
            lag_s,
            math.sqrt(var_s2),
            -offset_hz / self._hz_per_ppm,
            math.sqrt(var_hz2) / self._hz_per_ppm,
        )


LONGEST_S = 60.0  # without a phase, after which the next one tells nothing
WILD, SEEN = 5, 20  # so many of the last phases out of the way are too many


@dataclass(frozen=True)
class Phase:
    """A measured phase (rad, and its variance) and its time on the stream's clock."""

    t_ns: int
    rad: float
    var_rad2: float


class Cusum:
    """Of one epoch of one camera.

    Parameters
    ----------
    settings : LiveSettings
    nominal_hz : float

    Attributes
    ----------
    nats : float
        The sum.
    last : Phase or None
    """

    def __init__(self, settings: LiveSettings, nominal_hz: float) -> None:
        self._limits = settings.limits
        self.follows, self.any_grid = LagFilterBank(settings, nominal_hz), NullModel()
        self.nats = 0.0
        self.last: Phase | None = None
        self._out: deque[bool] = deque(maxlen=SEEN)

    @property
    def course(self) -> Course:
        """Lag and clock that fit best."""
        return self.follows.course

    def take(self, phase: Phase, moved_rad: FloatArray | None) -> None:
        """Take a phase in, with how far the reference's went since the last; None for unknown."""
        passed_s = (phase.t_ns - self.last.t_ns) / 1e9 if self.last else 0.0
        if passed_s > LONGEST_S:
            self.any_grid.lose_phase()
            self.nats = 0.0  # what followed the grid then needn't be what is shown now
        if moved_rad is None or passed_s > LONGEST_S:
            self.follows.lose_phase()
        moved = np.zeros(self.follows.lag_s.size) if moved_rad is None else moved_rad
        by_reference = self.follows.take(passed_s, phase.rad, phase.var_rad2, moved)
        by_any = self.any_grid.take(passed_s, phase.rad, phase.var_rad2)
        if moved_rad is not None and 0.0 < passed_s <= LONGEST_S:
            self._weigh(by_reference - by_any)
        self.last = phase

    def _weigh(self, nats: float) -> None:
        """Add what a phase tells; one that no grid would have tells of none."""
        self._out.append(self.any_grid.was_out)
        if self.is_wild:
            self.nats = 0.0
        elif not self.any_grid.was_out:
            now = self.nats + nats
            self.nats = min(max(now, self._limits.least), self._limits.most)

    @property
    def is_wild(self) -> bool:
        """Whether the phases of late jump about as no grid does: then they are none."""
        return sum(self._out) > WILD
