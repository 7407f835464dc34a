"""What any grid might have done, against multivariate normals with their whole covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsenf.flicker.grid_prior import INERTIA_S, WALKS, wander_rad2
from rsenf.match import ou_likelihood
from rsenf.match.clip_phase import ClipPhase
from rsenf.match.ou_likelihood import (
    BAD_SHARE,
    LIVELINESS,
    MEAN_STD_HZ,
    generic_log_likelihood,
    no_grid_log_likelihood,
)
from rsenf.match.phase_filter import blocks_of, clip_errors
from tests.oracle.dense_grid import log_density, strayed_rad2


def clip_with(seed, count=12, *, walk=False):
    """A clip's phases with holes, with errors that add up or don't."""
    rng = np.random.default_rng(seed)
    t_s = 0.5 + np.cumsum(rng.integers(1, 4, count)).astype(float)
    var, none = rng.uniform(1e-4, 1e-2, count), np.zeros(count)
    phase = np.cumsum(0.1 * rng.standard_normal(count))
    return ClipPhase(t_s, phase, none if walk else var, var if walk else none, 1.0, 50.0)


def densely(clip, bad=0.0):
    models = [(w * e.weight, livelier, e) for livelier, w in LIVELINESS for e in clip_errors(clip)]
    block, no_grid = blocks_of(clip), no_grid_log_likelihood(clip)
    return log_density(
        clip, models, lambda t_s: float(wander_rad2(t_s)), MEAN_STD_HZ, block, no_grid, bad
    )


@pytest.mark.parametrize("walk", [False, True], ids=["noise", "walk"])
def test_each_phase_after_those_before_is_as_likely_as_the_normal_says(walk):
    clip = clip_with(3, walk=walk)
    got = generic_log_likelihood(clip)
    assert got.shape == (clip.size,)
    assert got[0] == 0.0
    np.testing.assert_allclose(got, densely(clip), rtol=1e-6, atol=1e-6)
    got = generic_log_likelihood(clip, robust=True)
    np.testing.assert_allclose(got, densely(clip, BAD_SHARE), rtol=1e-6, atol=1e-6)


def test_whole_turns_of_a_phase_make_no_difference():
    clip = clip_with(6)
    turns = 2 * np.pi * np.random.default_rng(1).integers(-3, 4, clip.size)
    turned = replace(clip, phase_rad=clip.phase_rad + turns)
    got = generic_log_likelihood(turned)
    np.testing.assert_allclose(got, generic_log_likelihood(clip), rtol=1e-9, atol=1e-9)


def test_blocks_are_looked_at_for_themselves(monkeypatch):
    monkeypatch.setattr(ou_likelihood, "BLOCK", 5)
    clip = clip_with(4, count=14)
    parts = [densely(clip.between(a, a + 6))[1:] for a in (0, 5, 10)]
    np.testing.assert_allclose(
        generic_log_likelihood(clip), np.concatenate([[0.0], *parts]), rtol=1e-6, atol=1e-6
    )


def test_a_phase_or_none_is_no_news():
    clip = clip_with(5)
    assert generic_log_likelihood(clip.between(0, 1)).tolist() == [0.0]
    assert generic_log_likelihood(clip.between(0, 0)).size == 0


@pytest.mark.parametrize("t_s", [1.0, 5.0, 20.0, 100.0, 600.0, 3600.0])
def test_the_phase_strays_as_the_spectrum_says(t_s):
    assert wander_rad2(t_s) == pytest.approx(strayed_rad2(t_s, WALKS, INERTIA_S), rel=0.02)


def test_after_an_hour_it_strays_on_evenly():
    t_s = np.array([4000.0, 6000.0, 8000.0, 20000.0])
    strayed = wander_rad2(t_s)
    assert np.diff(strayed) / np.diff(t_s) == pytest.approx([strayed[1] / 6000.0] * 3, rel=0.2)


def test_a_clip_with_a_hole_of_hours_is_no_obstacle():
    t_s = np.concatenate([np.arange(20.0), np.arange(20.0) + 9000.0])
    clip = ClipPhase(t_s, np.zeros(40), np.full(40, 1e-3), np.zeros(40), 1.0, 50.0)
    assert np.isfinite(generic_log_likelihood(clip)).all()


def test_phases_of_no_grid_lie_anywhere_in_a_turn():
    clip = clip_with(7)
    expected = np.where(np.arange(clip.size) > 0, -np.log(2 * np.pi), 0.0)
    np.testing.assert_allclose(no_grid_log_likelihood(clip), expected)


def test_a_grids_course_is_told_from_errors_that_hang_together():
    """A smooth course is a grid's; one with the jitter of slow errors may be anything."""
    rng = np.random.default_rng(8)
    t_s, moved = np.arange(60.0), np.full(60, (4 * np.pi * 3e-4) ** 2)
    smooth_hz = 0.01 * np.sin(t_s / 25.0) + 3e-4 * rng.standard_normal(60)
    keep = np.exp(-1 / 8.0)
    rough_hz = np.zeros(60)
    for i in range(1, 60):
        rough_hz[i] = keep * rough_hz[i - 1] + 0.02 * (1 - keep**2) ** 0.5 * rng.standard_normal()
    for freq_hz, is_grid in ((smooth_hz, True), (rough_hz, False)):
        clip = ClipPhase(t_s, 4 * np.pi * np.cumsum(freq_hz), 0 * t_s, moved, 1.0, 50.0)
        shown = generic_log_likelihood(clip) - no_grid_log_likelihood(clip)
        assert (float(shown.sum()) > 10.0) is is_grid
