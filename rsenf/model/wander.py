"""A slow random series, for drift and fluctuation from frame to frame."""

from __future__ import annotations

import math

import numpy as np

from rsenf.model.grid import FloatArray


def wander(
    rng: np.random.Generator, count: int, step_s: float, time_constant_s: float
) -> FloatArray:
    """Draw a sampled, stationary Ornstein-Uhlenbeck process (AR(1)) of unit variance.

    Its correlation falls to 1/e in a time constant; its power is halved at
    ``1 / (2π · time_constant_s)``. A longer series begins with the shorter.

    Parameters
    ----------
    rng : numpy.random.Generator
    count : int
        Number of values.
    step_s : float
        Time between them.
    time_constant_s : float
        0 for white noise.
    """
    kicks = rng.standard_normal(count)
    if not time_constant_s:
        return kicks
    stay = math.exp(-step_s / time_constant_s)
    kicks[1:] *= math.sqrt(1 - stay * stay)
    values, now = kicks.tolist(), 0.0
    for k, kick in enumerate(values):
        values[k] = now = stay * now + kick
    return np.array(values)
