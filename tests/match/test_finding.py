"""Clips hidden in grids: found where they are, and nothing found where they are not."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from rsenf.match import MatchSettings
from rsenf.match.correlate import match_ncc
from tests.match.match_clips import clip_of, grid_from, wandering_grid

DAY = wandering_grid(20_000, seed=7)
SETTINGS = MatchSettings()


@pytest.mark.parametrize(
    ("start_s", "ppm", "seed"), [(1234.0, 0.0, 1), (9876.5, 70.0, 2), (17_000.3, -45.0, 3)]
)
def test_lag_and_clock_come_back(start_s, ppm, seed):
    found = match_ncc(clip_of(DAY, start_s, 300, seed, ppm=ppm), grid_from(DAY), SETTINGS)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(start_s, abs=4 * found.lag_std_s)
    assert found.lag_std_s < 0.3
    assert found.clock_ppm == pytest.approx(ppm, abs=4 * found.clock_std_ppm)
    assert found.clock_std_ppm < 10
    assert found.correlation > 0.99
    assert found.residual_std_hz < 1e-3
    assert found.seconds_used == 281
    assert found.search_size > 19_000
    assert found.verbal.endswith("support for this time")


@pytest.mark.parametrize("seed", range(5))
def test_means_of_a_second_are_found_but_not_taken_for_more_evidence_than_they_are(seed):
    """Neighbouring seconds of a grid are alike: sixty of them are not sixty independent values."""
    elsewhere = wandering_grid(3000, seed=100 + seed)
    start_s = 2000.4 + 3000 * seed
    there = match_ncc(clip_of(DAY, start_s, 180, seed, window_s=1.0), grid_from(DAY), SETTINGS)
    absent = match_ncc(clip_of(elsewhere, 1000, 60, seed, window_s=1.0), grid_from(DAY), SETTINGS)
    assert there.decision == "match"
    assert there.lag_s == pytest.approx(start_s, abs=4 * there.lag_std_s)
    assert there.seconds_used == 180
    assert absent.decision != "match"
    assert min(abs(a.lag_s - b.lag_s) for a, b in itertools.pairwise(there.candidates)) >= 30


def test_candidates_are_ranked_and_apart():
    found = match_ncc(clip_of(DAY, 5000, 120, 4), grid_from(DAY), SETTINGS)
    lags = [c.lag_s for c in found.candidates]
    ratios = [c.log10_lr for c in found.candidates]
    assert len(lags) == SETTINGS.candidates
    assert ratios == sorted(ratios, reverse=True)
    assert ratios[0] == found.log10_lr == pytest.approx(-ratios[1])
    assert min(abs(a - b) for i, a in enumerate(lags) for b in lags[:i]) >= 30
    assert found.candidates[0].correlation == found.correlation


def test_a_time_that_is_not_there_is_not_found():
    elsewhere = wandering_grid(3000, seed=99)
    long = match_ncc(clip_of(elsewhere, 1000, 900, 5), grid_from(DAY), SETTINGS)
    assert long.decision == "no_match"
    assert long.log10_lr_absent < 0
    assert long.verbal.endswith("against this time")
    short = match_ncc(clip_of(elsewhere, 1000, 60, 5), grid_from(DAY), SETTINGS)
    assert short.decision == "no_decision"


def test_a_gap_inside_the_clip_costs_seconds_and_nothing_else():
    freq = DAY.copy()
    freq[5100:5160] = np.nan
    found = match_ncc(clip_of(DAY, 5000.5, 300, 6), grid_from(freq), SETTINGS)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(5000.5, abs=0.5)
    # The reference averaged like the estimates is valid 10 s away from the gap.
    assert found.seconds_used in (281 - 60 - 20, 281 - 60 - 19, 281 - 60 - 18)


def test_nothing_is_said_about_times_that_fall_into_gaps():
    freq = DAY.copy()
    freq[4900:5400] = np.nan
    found = match_ncc(clip_of(DAY, 5000.5, 300, 6), grid_from(freq), SETTINGS)
    assert found.decision != "match"
    assert found.coverage_ratio < 0.99


def test_mostly_gaps_forbid_no_match():
    freq = np.full(DAY.size, np.nan)
    freq[:1500] = DAY[:1500]
    clip = clip_of(wandering_grid(3000, seed=99), 1000, 900, 5)
    found = match_ncc(clip, grid_from(freq), SETTINGS)
    assert found.decision == "no_decision"
    assert "could be compared" in found.reason


def test_unusable_seconds_are_left_out():
    track = clip_of(DAY, 8000.2, 400, 8)
    enf = track.enf_hz.copy()
    enf[np.random.default_rng(0).random(enf.size) < 0.4] = np.nan
    found = match_ncc(dataclasses.replace(track, enf_hz=enf), grid_from(DAY), SETTINGS)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(8000.2, abs=0.5)
    assert found.seconds_used == np.isfinite(enf).sum()


def test_a_clip_that_began_before_the_reference():
    found = match_ncc(clip_of(DAY, 100.0, 600, 9), grid_from(DAY[300:]), SETTINGS)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(-200, abs=0.5)


def test_references_of_other_steps():
    clip = clip_of(DAY, 6000.5, 300, 10)
    coarse = match_ncc(clip, grid_from(DAY.reshape(-1, 2).mean(axis=1), step_s=2.0), SETTINGS)
    assert coarse.decision == "match"
    assert coarse.lag_s == pytest.approx(6000.5, abs=0.5)
    fine = match_ncc(clip, grid_from(np.repeat(DAY, 10), step_s=0.1), SETTINGS)
    assert fine.decision == "match"
    assert fine.lag_s == pytest.approx(6000.5, abs=0.5)


def test_a_reference_averaged_by_somebody_is_recognised():
    from rsenf.match.clip_phase import average, window_kernel

    averaged = average(DAY, window_kernel(20.0, 1.0))
    clip = clip_of(DAY, 6000.5, 300, 11)
    for reference, how in ((averaged, "as it is"), (DAY, "averaged like the estimates")):
        found = match_ncc(clip, grid_from(reference), SETTINGS)
        assert found.decision == "match"
        assert how in found.reason
        assert found.residual_std_hz < 0.8e-3


def test_means_of_a_second_meet_averaged_and_coarse_references():
    from rsenf.match.clip_phase import average, window_kernel

    averaged = average(DAY, window_kernel(20.0, 1.0))
    clip = clip_of(DAY, 6000.5, 300, 11, window_s=1.0)
    for reference, how in ((averaged, "taken as an average already"), (DAY, "as it is")):
        found = match_ncc(clip, grid_from(reference), SETTINGS)
        assert found.decision == "match"
        assert how in found.reason
        assert found.lag_s == pytest.approx(6000.5, abs=4 * found.lag_std_s)
    coarse = match_ncc(clip, grid_from(DAY.reshape(-1, 2).mean(axis=1), step_s=2.0), SETTINGS)
    assert coarse.decision == "match"
    assert coarse.lag_s == pytest.approx(6000.5, abs=0.5)


def test_averaging_the_reference_lowers_the_residual():
    clip = clip_of(DAY, 6000.5, 300, 12)
    plain = match_ncc(clip, grid_from(DAY), MatchSettings(smoothing="none"))
    averaged = match_ncc(clip, grid_from(DAY), MatchSettings(smoothing="window"))
    assert averaged.residual_std_hz < 0.5 * plain.residual_std_hz
    assert averaged.correlation > plain.correlation


def test_the_errors_stated_are_the_errors_made():
    """Over many clips the lag's and the clock's errors are no larger than their standard errors."""
    z_lag, z_clock = [], []
    for seed in range(40):
        start_s = 500 + 470.3 * seed
        found = match_ncc(
            clip_of(DAY, start_s, 240, seed, ppm=20, std_hz=1e-3), grid_from(DAY), SETTINGS
        )
        z_lag.append((found.lag_s - start_s) / found.lag_std_s)
        z_clock.append((found.clock_ppm - 20) / found.clock_std_ppm)
    assert 0.3 < np.std(z_lag) < 1.3
    assert np.abs(z_lag).max() < 5
    assert np.std(z_clock) < 1.3


def test_the_same_input_gives_the_same_output():
    clip = clip_of(DAY, 6000.5, 120, 13)
    assert match_ncc(clip, grid_from(DAY), SETTINGS) == match_ncc(clip, grid_from(DAY), SETTINGS)


def test_a_reference_no_longer_than_the_clip():
    found = match_ncc(clip_of(DAY, 3000, 300, 14), grid_from(DAY[3000:3300]), SETTINGS)
    assert found.lag_s == pytest.approx(0, abs=0.5)
    assert found.decision in ("match", "no_decision")


def test_a_stuck_reference_decides_nothing():
    found = match_ncc(clip_of(DAY, 3000, 300, 15), grid_from(np.full(4000, 50.0)), SETTINGS)
    assert found.decision != "match"


def test_a_time_that_is_not_sharp_is_not_a_match():
    """A grid that hardly moves fits over seconds: the peak is there, its place isn't."""
    found = match_ncc(clip_of(DAY, 5000, 300, 4), grid_from(DAY), MatchSettings(tolerance_s=0.001))
    assert found.decision == "no_decision"
    assert "uncertain by over" in found.reason
