"""Likelihoods of phases by the covariance matrix of all of them at once: no filter, no factor."""

from __future__ import annotations

import numpy as np

RAD_PER_CYCLE = 4 * np.pi  # the light flickers at twice the grid's frequency


def sums_at_a_lag(clip, residual_rad, known, step_s, errors):
    """Return Σ log 2πF, Σ v²/F, Σ v·r/F and Σ r²/F of one lag under one size of the errors.

    Between two places where the reference doesn't tell the way, only differences to the first phase
    mean anything; a drift of the frequency's errors goes on from one stretch to the next.
    """
    starts = [i for i in range(clip.size) if i == 0 or not known[i]]
    stretches = list(zip(starts, [*starts[1:], clip.size], strict=True))
    pairs = [(a, i) for a, b in stretches for i in range(a + 1, b)]
    if not pairs:
        return np.zeros(4)
    covariance = drifted(clip, pairs, errors.clip)
    at = 0
    for a, b in stretches:
        if b - a > 1:
            own = slice(at, at + b - a - 1)
            covariance[own, own] += of_differences(clip.between(a, b), step_s, errors)
            at += b - a - 1
    v = np.array([residual_rad[i] - residual_rad[a] for a, i in pairs])
    r = RAD_PER_CYCLE * np.array([clip.t_s[i] - clip.t_s[a] for a, i in pairs])
    inverse = np.linalg.inv(covariance)
    _, log_det = np.linalg.slogdet(2 * np.pi * covariance)
    return np.array([log_det, v @ inverse @ v, v @ inverse @ r, r @ inverse @ r])


def drifted(clip, pairs, errors):
    """Covariance of the ways between pairs of phases by errors of frequencies with a memory."""
    out = np.zeros((len(pairs), len(pairs)))
    if errors.drift_s:
        moved = errors.ratio * np.sqrt(clip.walk_rad2)
        apart = np.abs(np.subtract.outer(clip.t_s, clip.t_s))
        steps = np.outer(moved, moved) * np.exp(-apart / errors.drift_s)
        for k, (a, i) in enumerate(pairs):
            for m, (b, j) in enumerate(pairs):
                out[k, m] = steps[a + 1 : i + 1, b + 1 : j + 1].sum()
    return out


def of_differences(clip, step_s, errors):
    """Covariance of the differences of the clip's phases to its first, but for a drift's part."""
    t_s = clip.t_s - clip.t_s[0]
    grow = np.diff(t_s) * (RAD_PER_CYCLE * errors.reference_hz) ** 2 * step_s
    white = 0.0 if errors.clip.drift_s else errors.clip.ratio**2
    walk = np.cumsum(grow + white * clip.walk_rad2[1:])
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
