"""The grid's frequency: a path, its phase by exact integration, and synthetic paths.

A synthetic path is a sum of two Ornstein-Uhlenbeck processes about the nominal frequency: the slow
balance of generation and load, and the fast one of primary control. Each quarter of an hour power
plants change their schedules, and the slow balance takes a step, within some seconds. The sum
passes the inertia of the rotating machines as two first-order low-passes, which make it smooth at
one second. With the constants below, the standard deviation of changes over 1, 10, 60 and 300 s is
1.3, 7.6, 14 and 23 mHz; over 40 s it is 16 mHz about the quarter and 12 otherwise. One day of the
Continental Europe grid has 1.4, 7.8, 14 and 22, and 16 and 12 mHz.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsenf.errors import UsageError
from rsenf.model.noise import generator

FloatArray = NDArray[np.float64]
SLOW_S = 280.0
FAST_S = 12.0
INERTIA_S = 1.3
FAST_SHARE = 0.33  # standard deviation over that of the path
SCHEDULE_S = 900.0
RAMP_S = 15.0  # duration of a step
STEP_SHARE = 0.7  # standard deviation of a step over that of the path


class GridPath:
    """Grid frequency over time, as seen from a camera that starts somewhere on it.

    Sample ``k`` covers ``[k·step, (k+1)·step)`` of the path. The frequency is linear between the
    centres of samples, and constant before the first and after the last one; the phase is its exact
    integral. NaN samples are interpolated linearly, for the light only, and listed in :attr:`gaps`.

    Parameters
    ----------
    freq_hz : array_like of float (samples,)
        Grid frequency; NaN where unknown.
    step_s : float
        Time between samples.
    start_s : float, optional
        Start of the camera: time from the beginning of sample 0 to the start of row 0 of the first
        frame. All times passed to the methods count from there.
    nominal_hz : float, optional
        50 or 60; by default the nearer one.

    Raises
    ------
    UsageError
        When no sample is finite, the frequency isn't a grid's, or the start is outside the path.

    Examples
    --------
    >>> grid = GridPath([50.0, 50.0, 50.02, 50.02])
    >>> grid.mean_hz(np.array([0.0, 2.0]), np.array([1.0, 3.0])).round(4).tolist()
    [50.0, 50.0175]
    """

    def __init__(
        self,
        freq_hz: ArrayLike,
        step_s: float = 1.0,
        start_s: float = 0.0,
        nominal_hz: float | None = None,
    ) -> None:
        path = np.array(freq_hz, dtype=np.float64)
        present = np.flatnonzero(np.isfinite(path))
        if path.ndim != 1 or not present.size:
            raise UsageError("the grid path holds no frequency")
        middle_hz = float(np.median(path[present]))
        self.nominal_hz = nominal_hz or (50.0 if middle_hz < 55 else 60.0)
        if abs(middle_hz / self.nominal_hz - 1) > 0.1:
            raise UsageError(
                f"the grid path is about {middle_hz:.4g} Hz, not near {self.nominal_hz:g} Hz",
                "halve an illumination frequency; name another grid as nominal",
            )
        if not 0 <= start_s < path.size * step_s:
            raise UsageError(
                f"the start at {start_s:g} s is not on the grid path",
                f"which lasts from 0 to {path.size * step_s:g} s",
            )
        self.step_s = float(step_s)
        self.start_s = float(start_s)
        edges = np.flatnonzero(np.diff(~np.isfinite(path), prepend=False, append=False))
        self.gaps = [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
        if self.gaps:
            path = np.interp(np.arange(path.size), present, path[present])
        self.freq_hz: FloatArray = path
        # Cycles from the first sample's centre to each centre; the trapezoidal rule is exact.
        steps = (path[1:] + path[:-1]) * (self.step_s / 2)
        self._cycles = np.concatenate(([0.0], np.cumsum(steps)))
        self._origin_cycles = 0.0
        self._origin_cycles = float(self.cycles(np.zeros(1))[0])

    @property
    def length_s(self) -> float:
        """Time from the camera's start to the end of the path."""
        return self.freq_hz.size * self.step_s - self.start_s

    def cycles(self, t_s: FloatArray) -> FloatArray:
        """Mains cycles since the camera's start, at times since then, of any shape."""
        t_s = np.asarray(t_s, np.float64)
        if t_s.ndim != 2 or not t_s.size:
            return self._cycles_at(t_s, np.floor(self._steps(t_s)))
        # Fast path: nearly all frames lie within one segment.
        first, last = (np.floor(self._steps(ends)) for ends in (t_s.min(axis=1), t_s.max(axis=1)))
        out, several = self._cycles_at(t_s, first[:, None]), first != last
        out[several] = self._cycles_at(t_s[several], np.floor(self._steps(t_s[several])))
        return out

    def frequency_hz(self, t_s: FloatArray) -> FloatArray:
        """Grid frequency at times since the camera's start, of any shape."""
        k, begin_s, slope = self._segment(np.floor(self._steps(t_s)))
        return np.asarray(self.freq_hz[k] + slope * (t_s - begin_s))

    def mean_hz(self, begin_s: FloatArray, end_s: FloatArray) -> FloatArray:
        """Mean frequency over intervals, their cycles over their length; times since the start."""
        return np.asarray((self.cycles(end_s) - self.cycles(begin_s)) / (end_s - begin_s))

    def gaps_within(self, duration_s: float) -> list[tuple[float, float]]:
        """Interpolated gaps within the first ``duration_s`` seconds, as times since the start."""
        spans = [(a * self.step_s - self.start_s, b * self.step_s - self.start_s)
                 for a, b in self.gaps]  # fmt: skip
        return [(a, b) for a, b in spans if b > 0 and a < duration_s]

    def _steps(self, t_s: FloatArray) -> FloatArray:
        """Times in steps after the centre of sample 0."""
        return np.asarray((np.asarray(t_s) + self.start_s) / self.step_s - 0.5)

    def _cycles_at(self, t_s: FloatArray, whole: FloatArray) -> FloatArray:
        """Cycles at times, given the index of the centre before each, which is broadcast."""
        k, begin_s, slope = self._segment(whole)
        beyond_s = t_s - begin_s
        out = np.asarray(slope / 2 * beyond_s)
        out += self.freq_hz[k]
        out *= beyond_s
        out += self._cycles[k] - self._origin_cycles
        return out

    def _segment(self, whole: FloatArray) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
        """Index of the centre before a time, its time, and the frequency's slope from it on."""
        last = self.freq_hz.size - 1
        k = np.clip(whole, 0, last).astype(np.intp)
        rise = self.freq_hz[np.minimum(k + 1, last)] - self.freq_hz[k]
        inside = (whole >= 0) & (k < last)
        begin_s = np.asarray((k + 0.5) * self.step_s - self.start_s, np.float64)
        return k, begin_s, np.where(inside, rise, 0.0) / self.step_s


def synthetic_grid(
    seed: int,
    duration_s: float,
    *,
    nominal_hz: float = 50.0,
    std_hz: float = 0.02,
    step_s: float = 1.0,
    start_s: float = 0.0,
) -> GridPath:
    """Draw a grid path.

    Parameters
    ----------
    seed : int
        The same seed gives the same path; a longer one begins with the shorter.
    duration_s : float
        Length of the path after ``start_s``.
    nominal_hz : float, optional
        50 or 60.
    std_hz : float, optional
        Long-term standard deviation; Continental Europe has about 0.02.
    step_s : float, optional
        Time between samples.
    start_s : float, optional
        Start of the camera on the path.
    """
    count = math.ceil((start_s + duration_s) / step_s) + 2
    rng = generator(seed, "grid path")
    # The variance of the steps is taken from that of the slow process.
    slow_share = 1 - FAST_SHARE**2 - STEP_SHARE**2 * SLOW_S / (2 * SCHEDULE_S)
    slow_std, fast_std = std_hz * math.sqrt(slow_share), std_hz * FAST_SHARE
    stay_slow, stay_fast, lag = (math.exp(-step_s / t) for t in (SLOW_S, FAST_S, INERTIA_S))
    kick_slow, kick_fast = (
        std * math.sqrt(1 - stay**2) for std, stay in ((slow_std, stay_slow), (fast_std, stay_fast))
    )
    slow, fast = slow_std * rng.standard_normal(), fast_std * rng.standard_normal()
    once = twice = slow + fast
    push_hz = STEP_SHARE * std_hz * _schedule_steps(seed, count, step_s)
    deviation_hz = np.empty(count)
    for k in range(count):
        slow = stay_slow * slow + kick_slow * rng.standard_normal()
        slow += push_hz[k]
        fast = stay_fast * fast + kick_fast * rng.standard_normal()
        once += (1 - lag) * (slow + fast - once)
        twice += (1 - lag) * (once - twice)
        deviation_hz[k] = twice
    return GridPath(nominal_hz + deviation_hz, step_s, start_s, nominal_hz)


def _schedule_steps(seed: int, count: int, step_s: float) -> FloatArray:
    """Change of the path at each sample by schedule steps, per unit of their standard deviation.

    The first step is at a random time within a quarter of an hour.
    """
    rng = generator(seed, "grid schedule")
    steps = np.zeros(count)
    t_s, ramp = rng.uniform(0, SCHEDULE_S), max(round(RAMP_S / step_s), 1)
    while (k := math.ceil(t_s / step_s)) < count:
        steps[k : k + ramp] = rng.standard_normal() / ramp
        t_s += SCHEDULE_S
    return steps
