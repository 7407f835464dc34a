"""Bad data excludes no time: a share of bad seconds, errors that hang together, islands."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.match import MatchSettings
from rsenf.match.clip_phase import clip_phase
from rsenf.match.phase import NO_EXCLUSION, NO_FIT, least_log10_lr, match_phase
from rsenf.messages import Header, MatchResult
from rsenf.report.verdict import verdict_words
from tests.match.phase_clips import hidden, stretch_of

DAY = stretch_of(12_000, seed=3)
ELSEWHERE = stretch_of(6_000, seed=4)
SETTINGS = MatchSettings()
SEEDS = range(6)


def hanging(rng, count, memory_s, dof=3.0):
    """Errors with heavy tails whose neighbours hang together, of unit size."""
    keep, out = np.exp(-1.0 / memory_s), np.zeros(count)
    for i in range(1, count):
        out[i] = keep * out[i - 1] + np.sqrt(1 - keep**2) * rng.standard_t(dof)
    return out


def worse(track, rad, own=...):
    """A track on whose phases errors are put, of which nothing is stated."""
    phase = track.phase_rad.copy()
    phase[own] += rad
    return dataclasses.replace(track, phase_rad=np.angle(np.exp(1j * phase)))


def of_frequencies(track, errors_hz, stated_hz, island=0, pause=0):
    """A track without phases, in islands of usable seconds."""
    count = track.enf_hz.size
    lost = (np.arange(count) % (island + pause) >= island) if island else np.zeros(count, bool)
    nothing = np.full(count, np.nan)
    return dataclasses.replace(
        track,
        enf_hz=np.where(lost, np.nan, track.enf_hz + errors_hz),
        var_hz2=np.full(count, stated_hz**2),
        phase_rad=nothing,
        phase_var_rad2=nothing,
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_a_share_of_bad_seconds_excludes_nothing(seed):
    rng = np.random.default_rng(seed)
    track, grid = hidden(DAY, seed, start_s=700.0 + 1500 * seed, seconds=240)
    first = int(rng.integers(180))
    bad = slice(first, first + 60)
    found = match_phase(worse(track, 0.8 * np.cumsum(hanging(rng, 60, 3.0)), bad), [grid], SETTINGS)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(700.0 + 1500 * seed, abs=0.5)
    assert found.clock_ppm == pytest.approx(0.0, abs=4 * found.clock_std_ppm)


def test_errors_with_tails_that_hang_together_exclude_nothing():
    right = 0
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        track, grid = hidden(DAY, seed, start_s=700.0 + 1500 * seed, seconds=180, noise_rad=0.02)
        found = match_phase(worse(track, 0.12 * hanging(rng, 180, 12.0)), [grid], SETTINGS)
        assert found.decision != "no_match"
        right += abs(found.lag_s - 700.0 - 1500 * seed) < 1.0
    assert right >= 5


@pytest.mark.parametrize(("island", "pause"), [(0, 0), (4, 20)], ids=["whole", "islands"])
def test_frequencies_much_worse_than_stated_exclude_nothing(island, pause):
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        track, grid = hidden(DAY, seed, start_s=700.0 + 1500 * seed, seconds=400)
        errors_hz = 2e-3 * 4 * hanging(rng, 400, 15.0)
        found = match_phase(of_frequencies(track, errors_hz, 2e-3, island, pause), [grid], SETTINGS)
        assert found.decision != "no_match"


def test_an_absent_time_is_excluded_all_the_same():
    """By phases and by frequencies that are what they are said to be."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        track, _ = hidden(ELSEWHERE, seed, start_s=500.0 + 900 * seed, seconds=300)
        grid = hidden(DAY, seed, start_s=100.0)[1]
        assert match_phase(track, [grid], SETTINGS).decision == "no_match"
        sums = of_frequencies(track, 3e-4 * rng.standard_normal(300), 3e-4)
        assert match_phase(sums, [grid], SETTINGS).decision == "no_match"


def test_a_bad_share_does_not_hide_an_absence():
    track, _ = hidden(ELSEWHERE, 1, start_s=900.0, seconds=300)
    spoilt = worse(track, np.random.default_rng(1).uniform(-3, 3, 60), slice(100, 160))
    assert match_phase(spoilt, [hidden(DAY, 1, start_s=100.0)[1]], SETTINGS).decision == "no_match"


def test_a_clip_that_follows_no_grid_can_exclude_none_and_is_told_so():
    rng = np.random.default_rng(2)
    track, _ = hidden(ELSEWHERE, 2, start_s=900.0, seconds=400)
    no_grid = of_frequencies(track, 0.02 * hanging(rng, 400, 8.0), 5e-4, 4, 20)
    found = match_phase(no_grid, [hidden(DAY, 2, start_s=100.0)[1]], SETTINGS)
    assert found.decision == "no_decision"
    assert found.log10_lr_absent == least_log10_lr(clip_phase(no_grid)) > -SETTINGS.min_log10_lr
    assert found.reason == NO_FIT
    assert NO_EXCLUSION in found.warnings


def test_holes_between_islands_tell_nothing():
    """What a sum of frequencies makes of a hole is no measurement, whatever lies beside it."""
    track, grid = hidden(DAY, 5, start_s=4000.0, seconds=400)
    islands = of_frequencies(track, np.zeros(400), 2e-4, 8, 12)
    found = match_phase(islands, [grid], SETTINGS)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(4000.0, abs=1.0)


@pytest.mark.parametrize("decision", ["no_match", "no_decision"])
@pytest.mark.parametrize("log10_lr", [-2.0, -0.5, 0.5, 2.0])
def test_the_words_follow_from_the_verdict(decision, log10_lr):
    result = MatchResult(
        header=Header(), method="phase", decision=decision, reason="so", lag_s=5.0, lag_std_s=0.1,
        correlation=0.5, log10_lr=log10_lr, log10_lr_absent=-2.3, search_size=10,
    )  # fmt: skip
    words = verdict_words(result)
    assert ("best fit" in words) is (decision != "no_match")
    assert not any("next best" in line and "more likely" in line for line in words.splitlines())
    assert ("none fits" in words) is (decision == "no_match")
