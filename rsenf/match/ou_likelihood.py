"""Likelihood of a clip's phases under any grid: Ornstein-Uhlenbeck processes about a free mean.

This is the alternative against which every lag is weighed.

Model: the frequency is the Gaussian process of :mod:`rsenf.flicker.grid_prior`, scaled by an
unknown factor (:data:`LIVELINESS`), about an unknown mean; the clip's errors are those of
:mod:`rsenf.match.phase_filter`.

Likelihood: of the phase steps, exact (Cholesky factor) within blocks of 600 phases, and a mixture
over the factors and the sizes of the errors. It also selects the inliers: motion or jumps of
brightness produce phases that no grid frequency explains; they would make every lag look wrong, and
the alternative too. For each block of 10 s, the log-likelihood ratio of a usual grid against no
grid is taken, and the block is left out below ``-CLEAR``. The selection uses the clip alone, so it
is the same for all lags.

Approximate: blocks are independent, and each step is unwrapped to the value nearest to its
prediction.

References
----------
- Rasmussen, C. E. and Williams, C. K. I. (2006), Gaussian Processes for Machine Learning, Eq. 2.30.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import wander_rad2
from rsenf.match.clip_phase import RAD_PER_CYCLE, ClipPhase
from rsenf.match.phase_filter import BLOCK_S, UNKNOWN_RAD2, blocks_of, clip_errors
from rsenf.messages.schema import FloatArray

BLOCK = 600  # phases with a joint covariance; blocks count as independent
KEPT = 512  # blocks whose likelihood is cached, 13 MB
MEAN_STD_HZ = 0.03  # of the ENF's mean over a clip about the nominal, clock errors included
TURN_RAD = 2.0 * np.pi
# Standard deviations and memories of smoothed frequency estimates without a grid behind them.
NO_GRID_HZ, NO_GRID_S = (0.005, 0.01, 0.02, 0.04), (2.0, 8.0, 30.0)
BAD_SHARE = 0.05  # prior share of blocks that follow no grid
LIVELINESS = ((0.5, 0.25), (1.0, 0.5), (2.0, 0.25))  # factors on the grid's wander, with weights
# Nats by which a block must be likelier under no grid than under a usual one, to be left out.
CLEAR = 6.0
MIN_KEPT = 10  # phases that must remain, or none is left out


def generic_log_likelihood(clip: ClipPhase, *, robust: bool = False) -> FloatArray:
    """Log-likelihood of each phase given those before it, if the light follows some grid.

    Parameters
    ----------
    clip : ClipPhase
    robust : bool
        Some blocks may be bad; then a block changes the weights of the models only as far as it may
        be good.

    Returns
    -------
    ndarray, shape (n,)
        Nats; zero for the first, whose phase is arbitrary.
    """
    blocks = (clip.between(start, start + BLOCK + 1) for start in range(0, clip.size - 1, BLOCK))
    parts = [
        _block(np.stack([b.t_s, b.phase_rad, b.var_rad2, b.walk_rad2]).tobytes(), b.hop_s)
        for b in blocks
    ]
    return np.concatenate([np.zeros(min(clip.size, 1)), *(part[int(robust)] for part in parts)])


def no_grid_log_likelihood(clip: ClipPhase) -> FloatArray:
    """Log-likelihood of each phase given those before it, if the light follows no grid.

    Measured phases are then uniform over a turn. Frequencies are errors with exponential
    autocorrelation, of unknown size and memory.

    Returns
    -------
    ndarray, shape (n,)
        Nats; zero for the first, and for sums of frequencies where the step is unknown.
    """
    if not clip.is_summed or clip.size < 2:
        return np.where(np.arange(clip.size) > 0, -np.log(TURN_RAD), 0.0)
    blocks = (clip.between(start, start + BLOCK + 1) for start in range(0, clip.size - 1, BLOCK))
    return np.concatenate([[0.0], *(_no_grid(block) for block in blocks)])


def _no_grid(clip: ClipPhase) -> FloatArray:
    """Log-likelihood of the steps of summed frequencies, if the light follows no grid."""
    dt_s, linked = np.diff(clip.t_s), clip.linked[1:]
    apart_s = np.abs(np.subtract.outer(clip.t_s[1:], clip.t_s[1:]))
    steady = (RAD_PER_CYCLE * MEAN_STD_HZ) ** 2 * np.outer(dt_s, dt_s)
    steady += np.diag(np.where(linked, 1e-12, UNKNOWN_RAD2))
    moved = RAD_PER_CYCLE**2 * np.outer(dt_s, dt_s)
    found = [
        _gaussian(np.diff(clip.phase_rad), steady + std_hz**2 * moved * np.exp(-apart_s / memory_s))
        for std_hz in NO_GRID_HZ
        for memory_s in NO_GRID_S
    ]
    return np.where(linked, _mixed(np.array(found), np.full(len(found), -np.log(len(found)))), 0.0)


@lru_cache(maxsize=KEPT)
def _block(held: bytes, hop_s: float) -> tuple[FloatArray, FloatArray]:
    """Log-likelihood of each step given those before, without and with bad blocks allowed for.

    Cached: a clip is evaluated again as it grows and when its finding is examined, so only new
    blocks are computed.
    """
    t_s, phase_rad, var_rad2, walk_rad2 = np.frombuffer(held).reshape(4, -1)
    clip = ClipPhase(t_s, phase_rad, var_rad2, walk_rad2, hop_s, np.nan)
    found, log_weight = _by_model(clip, LIVELINESS)
    plain, out = _mixed(found, log_weight), np.empty(clip.size - 1)
    block, no_grid = blocks_of(clip)[1:], no_grid_log_likelihood(clip)[1:]
    for number in np.unique(block):
        in_block = block == number
        out[in_block] = _mixed(found[:, in_block], log_weight)
        # A block updates the weights only as far as it may be good.
        total, bad = found[:, in_block].sum(axis=1), no_grid[in_block].sum()
        log_weight = log_weight + np.logaddexp(
            math.log1p(-BAD_SHARE) + total, math.log(BAD_SHARE) + bad
        )
        log_weight -= np.logaddexp.reduce(log_weight)
    return plain, out


def alone_log_likelihood(clip: ClipPhase) -> FloatArray:
    """Log-likelihood as :func:`generic_log_likelihood`, for a few phases under a usual grid."""
    found, log_weight = _by_model(clip, ((1.0, 1.0),))
    return np.concatenate([[0.0], _mixed(found, log_weight)])


def _by_model(
    clip: ClipPhase, liveliness: Sequence[tuple[float, float]]
) -> tuple[FloatArray, FloatArray]:
    """Log-likelihood of each step under each model, (models, steps), and the log prior weights."""
    steps = np.diff(clip.phase_rad)
    wander, every = _wander(clip), clip_errors(clip)
    noises = {drift_s: _noise(clip, drift_s) for drift_s in {errors.drift_s for errors in every}}
    sizes = {(errors.wander_rad, errors.wander_s) for errors in every}
    bounded = {size: _bounded(clip, *size) for size in sizes}
    # An unknown step over a hole must not affect the prediction of those after it.
    unknown = np.diag(np.where(clip.linked[1:], 0.0, UNKNOWN_RAD2))
    covariance = np.empty_like(wander)
    found, weights = [], []
    for errors in every:
        noise = errors.ratio**2 * noises[errors.drift_s] + unknown
        noise += bounded[errors.wander_rad, errors.wander_s]
        for livelier, weight in liveliness:
            np.multiply(wander, livelier**2, out=covariance)
            covariance += noise
            found.append(_gaussian(steps, covariance))
            weights.append(weight * errors.weight)
    return np.array(found), np.log(weights)


def _wander(clip: ClipPhase) -> FloatArray:
    """Covariance of the phase steps due to the grid's frequency and its unknown mean."""
    dt = np.diff(clip.t_s)
    mean = (RAD_PER_CYCLE * MEAN_STD_HZ) ** 2 * np.outer(dt, dt)
    return _of_steps(clip, wander_rad2) + mean


def _bounded(clip: ClipPhase, wander_rad: float, wander_s: float) -> FloatArray:
    """Covariance of the phase steps due to an Ornstein-Uhlenbeck process in the clip's phase."""
    if not wander_rad:
        return np.zeros((clip.size - 1, clip.size - 1))
    return _of_steps(clip, lambda t_s: 2.0 * wander_rad**2 * -np.expm1(-t_s / wander_s))


def _of_steps(clip: ClipPhase, spread_rad2: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Covariance of the phase steps, from the phase's mean square change over a time."""
    index = np.rint((clip.t_s - clip.t_s[0]) / clip.hop_s).astype(np.int64)
    spread = spread_rad2(np.arange(index[-1] + 1) * clip.hop_s)
    over = spread[np.abs(np.subtract.outer(index, index))]
    return np.asarray(
        (over[1:, :-1] + over[:-1, 1:] - over[:-1, :-1] - over[1:, 1:]) / 2.0, np.float64
    )


def _noise(clip: ClipPhase, drift_s: float) -> FloatArray:
    """Covariance of the phase steps due to the estimates' errors; ``drift_s`` is their memory."""
    var = clip.var_rad2
    beside = -var[1:-1]
    noise = np.diag(var[1:] + var[:-1] + 1e-12) + np.diag(beside, 1) + np.diag(beside, -1)
    if not drift_s:
        return np.asarray(noise + np.diag(clip.walk_rad2[1:]), np.float64)
    moved, t_s = np.sqrt(clip.walk_rad2[1:]), clip.t_s[1:]
    apart_s = np.abs(np.subtract.outer(t_s, t_s))
    return np.asarray(noise + np.outer(moved, moved) * np.exp(-apart_s / drift_s), np.float64)


def _gaussian(steps: FloatArray, covariance: FloatArray) -> FloatArray:
    """Log-likelihood of each value given those before, by the Cholesky factor.

    Steps are known modulo a turn: each is unwrapped to the value nearest to its prediction from the
    steps before, as the phase filter does at a lag, so that a cycle slip costs the same in both.
    """
    from scipy.linalg import solve_triangular

    root = np.linalg.cholesky(covariance)
    std = np.diag(root)
    white = solve_triangular(root, steps, lower=True, check_finite=False)
    slips = np.flatnonzero(np.abs(white * std) > TURN_RAD / 2.0)
    for i in range(slips[0], steps.size) if slips.size else ():
        away = float(steps[i] - root[i, :i] @ white[:i])
        white[i] = (away - TURN_RAD * round(away / TURN_RAD)) / std[i]
    return np.asarray(-0.5 * white**2 - np.log(std) - 0.5 * np.log(TURN_RAD))


def _mixed(log_likelihood: FloatArray, log_weight: FloatArray) -> FloatArray:
    """Log of each value's likelihood, averaged over models with their posterior weights so far."""
    sums = np.cumsum(log_likelihood, axis=1) + log_weight[:, None]
    total = np.logaddexp.reduce(sums, axis=0)
    return np.diff(total, prepend=np.logaddexp.reduce(log_weight))


@lru_cache(maxsize=4)
def inliers(clip: ClipPhase) -> NDArray[np.bool_]:
    """Return which phases may follow a grid; all if fewer than :data:`MIN_KEPT` would remain.

    Each block of :data:`BLOCK_S` is tested independently of its neighbours.
    """
    is_inlier = np.ones(clip.size, np.bool_)
    for first, last in stretches(clip):
        part = clip.between(first, last)
        if part.size > 1 and part.linked[1:].any():
            counted = part.linked[1:].astype(np.float64)
            shown = (alone_log_likelihood(part) - no_grid_log_likelihood(part))[1:] @ counted
            is_inlier[first:last] = shown >= -CLEAR
    return is_inlier if is_inlier.sum() >= MIN_KEPT else np.ones(clip.size, np.bool_)


def stretches(clip: ClipPhase) -> list[tuple[int, int]]:
    """Return the blocks of a clip as index ranges (first, first of the next)."""
    number = (clip.t_s - clip.t_s[0]) // BLOCK_S
    first = np.flatnonzero(np.diff(number, prepend=-1.0))
    return list(zip(first.tolist(), [*first[1:].tolist(), clip.size], strict=True))
