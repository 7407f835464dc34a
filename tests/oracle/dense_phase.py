"""Likelihoods of phases by the covariance matrix of all of them at once: no filter, no factor."""

from __future__ import annotations

import numpy as np

RAD_PER_CYCLE = 4 * np.pi  # the light flickers at twice the grid's frequency


def sums_at_a_lag(clip, residual_rad, known, step_s, errors):
    """Return Σ log 2πF, Σ v²/F, Σ v·r/F and Σ r²/F of one lag under one size of the errors.

    Between two places where the reference doesn't tell the way, only differences to the first phase
    mean anything.
    """
    total = np.zeros(4)
    starts = [i for i in range(clip.size) if i == 0 or not known[i]]
    for a, b in zip(starts, [*starts[1:], clip.size], strict=True):
        if b - a < 2:
            continue
        covariance = of_differences(clip.between(a, b), step_s, errors)
        v = residual_rad[a + 1 : b] - residual_rad[a]
        r = RAD_PER_CYCLE * (clip.t_s[a + 1 : b] - clip.t_s[a])
        inverse = np.linalg.inv(covariance)
        _, log_det = np.linalg.slogdet(2 * np.pi * covariance)
        total += [log_det, v @ inverse @ v, v @ inverse @ r, r @ inverse @ r]
    return total


def of_differences(clip, step_s, errors):
    """Covariance of the differences of the clip's phases to its first."""
    t_s = clip.t_s - clip.t_s[0]
    grow = np.diff(t_s) * (RAD_PER_CYCLE * errors.reference_hz) ** 2 * step_s
    walk = np.cumsum(grow + errors.clip.ratio**2 * clip.walk_rad2[1:])
    noise = errors.clip.ratio**2 * clip.var_rad2

    def wander(i, j):
        return errors.clip.wander_rad**2 * np.exp(-abs(t_s[i] - t_s[j]) / errors.clip.wander_s)

    out = np.empty((walk.size, walk.size))
    for i in range(1, walk.size + 1):
        for j in range(1, walk.size + 1):
            bounded = wander(i, j) - wander(i, 0) - wander(0, j) + wander(0, 0)
            own = noise[0] + (noise[i] if i == j else 0.0)
            out[i - 1, j - 1] = walk[min(i, j) - 1] + bounded + own
    return out
