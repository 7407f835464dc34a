"""Sums, profile likelihood and standard error, against slow least squares over every frame."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import stdtrit

from rsenf.idle.coherent import idle_ratio_bound
from rsenf.idle.estimator_state import Finding
from rsenf.idle.moments import HARMONICS, Moments
from rsenf.idle.ramp import (
    Profile,
    Ramp,
    bands,
    bend_var,
    bends,
    find_ramp,
    freedom,
    jackknife_var,
    left_out,
)
from tests.oracle.ramp_search import explained_by_ramp

Float = NDArray[np.float64]
FRAMES, ROWS = 300, 64


def clip(
    turns: float,
    *,
    advance: float = 2.1,
    noise: float = 0.3,
    seed: int = 0,
    frames: int = FRAMES,
    rows: int = ROWS,
) -> tuple[Float, Float, Float]:
    """Rows of uneven brightness under a lamp with two harmonics: levels, phases, brightness."""
    rng = np.random.default_rng(seed)
    phase = np.cumsum(advance + 0.02 * rng.standard_normal(frames))
    brightness = rng.uniform(60, 140, rows)
    at = phase[:, None] + 2 * np.pi * turns * np.arange(rows) / rows
    light = 1 + 0.08 * np.cos(at + 0.4) + 0.02 * np.cos(2 * at - 1.0)
    return (
        brightness * light + noise * rng.standard_normal((frames, rows)),
        phase,
        brightness,
    )


def moments_of(level: Float, phase: Float, step: int = FRAMES) -> Moments:
    out = Moments(level.shape[1])
    for first in range(0, len(level), step):
        out.add(phase[first : first + step], level[first : first + step])
    return out


def fit(level: Float, phase: Float) -> tuple[Ramp, float]:
    """Return the ramp, and its variance by leaving out bands."""
    moments = moments_of(level, phase)
    ramp = find_ramp(moments, 4.0)
    return ramp, jackknife_var(Profile(moments, moments.harmonics(), ramp.brightness), ramp.turns)


def test_sums_do_not_depend_on_how_frames_come() -> None:
    level, phase, _ = clip(2.3)
    once, often = moments_of(level, phase), moments_of(level, phase, 7)
    assert once.frames == often.frames
    assert np.allclose(once.row, often.row, rtol=1e-12)
    assert np.allclose(once.turn, often.turn, atol=1e-9)


@pytest.mark.parametrize("harmonics", [1, 2, 3])
@pytest.mark.parametrize("advance", [2.1, 0.01])
def test_profile_equals_least_squares_over_all_frames(harmonics: int, advance: float) -> None:
    level, phase, brightness = clip(2.3, advance=advance)
    profile = Profile(moments_of(level, phase), harmonics, brightness)
    tries = np.array([-2.3, 0.4, 2.1, 2.3, 2.35])
    fast = profile.explained(tries)
    slow = [explained_by_ramp(level, phase, brightness, t, harmonics) for t in tries]
    assert fast == pytest.approx(slow, rel=1e-4)


@pytest.mark.parametrize("turns", [-3.1, -0.6, 0.7, 2.31, 3.6])
def test_top_is_that_of_the_slow_search(turns: float) -> None:
    level, phase, _ = clip(turns, seed=3)
    ramp, _ = fit(level, phase)
    near = ramp.turns + np.linspace(-2e-3, 2e-3, 41)
    slow = [explained_by_ramp(level, phase, ramp.brightness, t, HARMONICS) for t in near]
    assert abs(near[int(np.argmax(slow))] - ramp.turns) <= 1.01e-4
    assert abs(ramp.turns - turns) < 5 * np.sqrt(ramp.bound_var)


def test_brightness_amplitude_and_noise_are_those_of_the_clip() -> None:
    level, phase, brightness = clip(2.3)
    ramp, _ = fit(level, phase)
    assert ramp.brightness == pytest.approx(brightness, rel=1e-3)
    assert ramp.flicker_ratio == pytest.approx(0.08, rel=0.01)
    assert abs(ramp.amplitude[1]) == pytest.approx(0.02, rel=0.05)
    assert ramp.noise_var == pytest.approx(0.09, rel=0.05)


def test_flicker_that_hardly_turns_is_told_from_texture() -> None:
    # Three radians in all: a row's own mean holds flicker, and no row alone could tell.
    level, phase, _ = clip(2.3, advance=0.01, seed=5)
    ramp, variance = fit(level, phase)
    assert abs(ramp.turns - 2.3) < 4 * np.sqrt(max(variance, ramp.bound_var))
    assert abs(ramp.turns - 2.3) < 3e-3


def test_standard_errors_are_true_for_white_noise() -> None:
    scores, ratios, bent = [], [], []
    for seed in range(30):
        level, phase, _ = clip(2.3, noise=2.0, seed=seed, frames=120)
        ramp, variance = fit(level, phase)
        scores.append((ramp.turns - 2.3) / np.sqrt(max(variance, ramp.bound_var)))
        profile = Profile(moments_of(level, phase), HARMONICS, ramp.brightness)
        ratios.append(variance / ramp.bound_var)
        bent.append(bend_var(profile, ramp.turns) / ramp.bound_var)
    assert 0.7 < np.mean(bent) < 1.4
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4
    assert 0.7 < np.mean(ratios) < 1.6


def test_standard_errors_are_true_for_errors_of_whole_bands() -> None:
    """As a codec's: the phase of a band of rows is off, by the same for the whole clip."""
    scores, rows = [], 960
    for seed in range(20):
        rng = np.random.default_rng([seed, 1])
        _, phase, brightness = clip(2.3, noise=0.0, seed=seed, frames=60, rows=rows)
        at = phase[:, None] + 2 * np.pi * 2.3 * np.arange(rows) / rows
        at = at + np.repeat(rng.normal(0, 0.2, rows // 48), 48)
        ramp, variance = fit(brightness * (1 + 0.08 * np.cos(at)), phase)
        scores.append((ramp.turns - 2.3) / np.sqrt(variance))
        assert variance > 20 * ramp.bound_var
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_ramp_is_as_uncertain_as_it_is_bent() -> None:
    """One of six bends, of so many turns, is what the straight line may be wrong by as well."""
    rows, turns = 240, 0.02
    _, phase, brightness = clip(2.3, noise=0.0, frames=60, rows=rows)
    course = 2.3 * np.arange(rows) / rows + turns * bends(brightness**2)[3]
    at = phase[:, None] + 2 * np.pi * course
    moments = moments_of(brightness * (1 + 0.08 * np.cos(at)), phase)
    ramp = find_ramp(moments, 4.0)
    profile = Profile(moments, HARMONICS, ramp.brightness)
    assert bend_var(profile, ramp.turns) == pytest.approx(turns**2 / 6, rel=0.05)


def test_bends_are_orthogonal_and_of_the_straight_lines_size() -> None:
    weight = np.random.default_rng(0).uniform(0.2, 1.0, 240)
    shapes = bends(weight)
    gram = (shapes * weight) @ shapes.T
    assert gram == pytest.approx(gram[0, 0] * np.eye(len(shapes)), abs=1e-9)
    assert np.ptp(np.diff(shapes[0])) < 1e-12
    assert np.abs(np.diff(shapes[0])).mean() == pytest.approx(1 / 240)


@pytest.mark.parametrize("rows", [240, 480, 720, 1080, 2160])
def test_interval_is_that_of_students_t(rows: int) -> None:
    finding = Finding(verdict="estimated", freedom=freedom(rows))
    assert finding.interval_stds == pytest.approx(stdtrit(freedom(rows), 0.975), rel=2e-3)


def test_bands_cover_all_rows_once() -> None:
    for rows in (16, 100, 480, 719, 1080):
        assert bands(rows)[0] == 0
        weight = left_out(rows)
        assert np.all((1 - weight).sum(axis=0) == 1)
        assert len(weight) >= 10


def test_bound_is_the_curvature_of_the_likelihood() -> None:
    level, phase, _ = clip(2.3, noise=0.5, frames=600)
    ramp, _ = fit(level, phase)
    mean = np.sqrt(np.mean(ramp.brightness**2))
    bound = idle_ratio_bound(
        noise_level=0.5,
        amplitude_level=[0.08 * mean, 0.02 * mean],
        frames=600,
        rows=ROWS,
        frame_rate_hz=30.0,
        f0_hz=100.0,
    )
    assert bound == pytest.approx(np.sqrt(ramp.bound_var) * 30.0 / 100.0, rel=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_a_harmonic_that_hardly_turns_says_nothing_of_the_ramp(seed: int) -> None:
    """The third of 50 Hz light at 30 frames/s goes as slowly as shades creep over the picture."""
    level, phase, _ = clip(2.3, seed=seed, advance=2 * np.pi / 3 + 0.002, rows=240)
    place, t = np.linspace(0.0, 1.0, 240), np.linspace(0.0, 1.0, FRAMES)[:, None]
    level *= 1.0 + 0.1 * np.sin(7.0 * t) * np.sin(4.0 * np.pi * place)
    moments = moments_of(level, phase)
    assert moments.harmonics() == 2
    ramp, var = fit(level, phase)
    assert abs(ramp.turns - 2.3) < 4.0 * var**0.5
    assert var < 0.6 * jackknife_var(Profile(moments, HARMONICS, ramp.brightness), ramp.turns)
