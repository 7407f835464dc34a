"""The filter against the covariance matrix of all phases at once: gaps, clock ramp and wander."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from rsenf.match import MatchSettings
from rsenf.match.clip_phase import ClipPhase
from rsenf.match.phase_filter import ERRORS, ClipErrors, Errors, Innovations, blocks_of, innovations
from rsenf.match.phase_scorer import CLOCKS, PhaseScorer, rougher
from rsenf.match.series import Grid
from tests.oracle.dense_phase import of_differences, sums_at_a_lag

STEP_S = 2.0
SIZES = (
    Errors(0.2, 3e-4, ClipErrors(1.0, 1.0, 0.15, 10.0)),
    Errors(0.3, 1e-3, ClipErrors(1.0, 2.5)),
    Errors(0.1, 1e-4, ClipErrors(1.0, 1.0, 0.06, 3.0)),
    Errors(0.4, 2.5e-3, ClipErrors(1.0, 1.0)),
    Errors(0.4, 1e-3, ClipErrors(1.0, 4.0, drift_s=10.0)),
)


def clip_with(rng, count=20, *, walk=False):
    """A clip's phases at uneven instants, and with errors that add up or don't."""
    t_s = 0.5 + np.cumsum(rng.integers(1, 4, count)).astype(float)
    var = rng.uniform(1e-4, 1e-2, count)
    none = np.zeros(count)
    phase = np.cumsum(0.03 * rng.standard_normal(count))
    return ClipPhase(t_s, phase, none if walk else var, var if walk else none, 1.0, 50.0)


def compare(clip, residual, known, found):
    found = Innovations(
        *(part.sum(axis=0) for part in (found.log_f, found.vv, found.vr, found.rr)), found.count
    )
    for e, errors in enumerate(SIZES):
        for c in range(residual.shape[1]):
            own = known[:, min(c, known.shape[1] - 1)]
            expected = sums_at_a_lag(clip, residual[:, c], own, STEP_S, errors)
            shared = min(c, found.rr.shape[1] - 1)
            got = (found.log_f[e, shared], found.vv[e, c], found.vr[e, c], found.rr[e, shared])
            unit = np.array([1.0, 1.0, max(expected[3], 1.0) ** 0.5, max(expected[3], 1.0)])
            np.testing.assert_allclose(got / unit, expected / unit, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("walk", [False, True], ids=["noise", "walk"])
@pytest.mark.parametrize("gaps", [0, 2, 5], ids=["whole", "mixed", "gaps"])
def test_every_lag_and_size_equals_the_dense_likelihood(walk, gaps):
    rng = np.random.default_rng(3)
    clip = clip_with(rng, walk=walk)
    residual = clip.phase_rad[:, None] + np.cumsum(0.02 * rng.standard_normal((20, 5)), axis=0)
    known = np.ones((20, 5), bool)
    known[:, :gaps] = rng.random((20, gaps)) > 0.15
    known[0] = False
    found = innovations(clip, residual, known, STEP_S, SIZES)
    compare(clip, residual, known, found)
    np.testing.assert_array_equal(found.count, known.sum(axis=0))


def test_lags_that_know_the_same_share_one_column():
    rng = np.random.default_rng(4)
    clip = clip_with(rng)
    residual = clip.phase_rad[:, None] + 0.05 * rng.standard_normal((20, 3))
    known = np.ones((20, 1), bool)
    known[[0, 11]] = False
    found = innovations(clip, residual, known, STEP_S, SIZES)
    assert found.rr.shape == (blocks_of(clip)[-1] + 1, len(SIZES), 1)
    compare(clip, residual, known, found)


def test_whole_turns_of_the_phase_make_no_difference():
    rng = np.random.default_rng(5)
    clip = clip_with(rng)
    residual = clip.phase_rad[:, None] + 0.05 * rng.standard_normal((20, 4))
    known = rng.random((20, 4)) > 0.1
    known[0] = False
    turned = residual + 2 * np.pi * rng.integers(-3, 4, residual.shape)
    for name in ("log_f", "vv", "vr", "rr"):
        plain, other = (
            getattr(innovations(clip, r, known, STEP_S, SIZES), name) for r in (residual, turned)
        )
        np.testing.assert_allclose(other, plain, rtol=1e-9, atol=1e-9)


def test_a_wrong_lag_wraps_step_by_step():
    """Where the phase runs away, each step is looked at by what is left of whole turns."""
    clip = ClipPhase(np.arange(5.0), np.zeros(5), np.full(5, 1e-4), np.zeros(5), 1.0, 50.0)
    known = np.array([[False], [True], [True], [True], [True]])
    residual = (2 * np.pi - 0.01) * np.arange(5.0)[:, None]
    slow = -0.01 * np.arange(5.0)[:, None]
    ran, crept = (innovations(clip, r, known, STEP_S, SIZES) for r in (residual, slow))
    np.testing.assert_allclose(ran.vv, crept.vv, rtol=1e-9)


def test_a_lag_without_two_phases_in_a_row_says_nothing():
    clip = clip_with(np.random.default_rng(6))
    found = innovations(clip, np.ones((20, 2)), np.zeros((20, 2), bool), STEP_S, SIZES)
    for part in (found.log_f, found.vv, found.vr, found.rr, found.count):
        assert not part.any()


def test_the_clock_is_weighed_as_a_ramp_of_unknown_slope():
    """Score of a lag: the mean of dense Gaussians, one for each size of errors and of clocks."""
    clip, settings = clip_with(np.random.default_rng(7)), MatchSettings()
    d, ramp = clip.phase_rad[1:] - clip.phase_rad[0], 4 * np.pi * (clip.t_s[1:] - clip.t_s[0])
    density = 0.0
    for errors in rougher(ERRORS, settings.reference_noise_hz):
        for share, size in CLOCKS:
            slope_hz = size * settings.clock_scale_ppm * 1e-6 * 50.0
            covariance = of_differences(clip, STEP_S, errors) + slope_hz**2 * np.outer(ramp, ramp)
            density += errors.weight * share * multivariate_normal.pdf(d, cov=covariance)
    grid = Grid("flat", 50.0, 0, STEP_S, np.full(200, 50.0))
    scorer = PhaseScorer(clip, grid, settings, robust=False)
    every = np.ones((clip.size, 1), bool)
    above_any_grid = np.log(density) - scorer.readings[0].generic.sum()
    assert scorer.scores(np.array([17.0]), every)[0] == pytest.approx(above_any_grid, rel=1e-9)
