"""Phases under any grid whatever, as one multivariate normal after the other: no factors."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.integrate import quad

RAD_PER_CYCLE = 4 * np.pi  # the light flickers at twice the grid's frequency


def strayed_rad2(t_s, walks, inertia_s):
    """Mean square by which the phase strays in a time, from the frequency's spectrum."""

    def density(f):
        w = 2 * np.pi * f
        of_walks = sum(std**2 * 2 * s / (1 + (w * s) ** 2) for std, s in walks)
        return (
            of_walks
            / (1 + (w * inertia_s) ** 2) ** 2
            * (np.sin(np.pi * f * t_s) / (np.pi * f)) ** 2
        )

    edges = [1e-9, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 4.0]
    one_sided = sum(quad(density, a, b, limit=4000)[0] for a, b in pairwise(edges))
    return RAD_PER_CYCLE**2 * 2 * one_sided


def log_density(clip, models, strayed, mean_std_hz, block, no_grid, bad):
    """Log-likelihood of each phase given those before, of a mixture of (weight, livelier, errors).

    A block of phases may be bad, which is as likely as ``bad``; it is worth ``no_grid`` then, to
    the weights that the mixture has after it.
    """
    t_s, n = clip.t_s - clip.t_s[0], clip.size
    moved, steps = np.diff(clip.phase_rad), np.diff(np.eye(n), axis=0)  # of phases to steps
    grid, white, apart = (np.zeros((n, n)) for _ in range(3))
    lost = np.where(clip.linked, 0.0, 1e6)  # of the ways over holes of a sum nothing is known
    for i in range(n):
        for j in range(n):
            grid[i, j] = (strayed(t_s[i]) + strayed(t_s[j]) - strayed(abs(t_s[i] - t_s[j]))) / 2
            grid[i, j] += (RAD_PER_CYCLE * mean_std_hz) ** 2 * t_s[i] * t_s[j]
            white[i, j] = clip.walk_rad2[1 : min(i, j) + 1].sum()
            apart[i, j] = abs(t_s[i] - t_s[j])
    found = np.zeros((len(models), n))
    for m, (_, livelier, errors) in enumerate(models):
        walk = _drifted(clip, errors.drift_s) if errors.drift_s else white
        noise = errors.ratio**2 * (walk + np.diag(clip.var_rad2))
        noise += [[lost[1 : min(i, j) + 1].sum() for j in range(n)] for i in range(n)]
        bounded = errors.wander_rad**2 * np.exp(-apart / errors.wander_s)
        covariance = steps @ (livelier**2 * grid + noise + bounded) @ steps.T
        for k in range(1, n):
            own = covariance[:k, :k]
            _, log_det = np.linalg.slogdet(2 * np.pi * own)
            found[m, k] = -(log_det + moved[:k] @ np.linalg.solve(own, moved[:k])) / 2
    weights = np.array([weight for weight, _, _ in models])
    out = np.zeros(n)
    for number in sorted(set(block[1:])):
        own = [k for k in range(1, n) if block[k] == number]
        since = np.exp(found[:, own] - found[:, [own[0] - 1]])
        out[own] = np.diff(np.log(weights @ since), prepend=0.0)
        weights = weights * ((1 - bad) * since[:, -1] + bad * np.exp(no_grid[own].sum()))
        weights /= weights.sum()
    return out


def _drifted(clip, memory_s):
    """Covariance of sums of frequencies whose errors hang together."""
    moved, n = np.sqrt(clip.walk_rad2), clip.size
    apart = np.abs(np.subtract.outer(clip.t_s, clip.t_s))
    steps = np.outer(moved, moved) * np.exp(-apart / memory_s)
    return np.array([[steps[1 : i + 1, 1 : j + 1].sum() for j in range(n)] for i in range(n)])
