"""Synthetic grid frequency: Ornstein-Uhlenbeck processes about the nominal frequency.

Two are added: the slow balance of generation and load, and the fast one of primary control. Each
quarter of an hour power plants change their schedules, and the slow balance takes a step, within
some seconds. The sum passes the inertia of the rotating machines as two first-order low-passes,
which make it smooth at one second. With the constants below, the standard deviation of changes over
1, 10, 60 and 300 s is 1.3, 7.6, 14 and 23 mHz; over 40 s it is 16 mHz about the quarter and 12
otherwise. One day of the Continental Europe grid has 1.4, 7.8, 14 and 22, and 16 and 12 mHz.
"""

from __future__ import annotations

import math

import numpy as np

from rsenf.model.grid import FloatArray, GridPath
from rsenf.model.seeds import generator

SLOW_S = 280.0
FAST_S = 12.0
INERTIA_S = 1.3
FAST_SHARE = 0.33  # standard deviation over that of the path
SCHEDULE_S = 900.0
RAMP_S = 15.0  # duration of a step
STEP_SHARE = 0.7  # standard deviation of a step over that of the path


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
