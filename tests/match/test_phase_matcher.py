"""The phase matcher: a clip is found where it is, and nothing is found where it isn't."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.match import MatchSettings
from rsenf.match.calibration import CalibrationLine, calibration
from rsenf.match.clip_phase import window_kernel
from rsenf.match.phase import match_phase
from rsenf.match.stage import Match
from rsenf.timebase import nanoseconds
from tests.match.match_clips import clip_of, estimates_from
from tests.match.phase_clips import hidden, stretch_of

DAY = stretch_of(20_000, seed=3)
ELSEWHERE = stretch_of(6_000, seed=4)
SETTINGS = MatchSettings()
T0_NS = 1_663_372_800_000_000_000


@pytest.mark.parametrize(
    ("start_s", "ppm", "noise_rad"),
    [(2345.25, 0.0, 0.001), (9876.6, 70.0, 0.02), (17_000.3, -20.0, 0.05), (5000.9, 5.0, 0.02)],
)
def test_lag_and_clock_come_back(start_s, ppm, noise_rad):
    track, grid = hidden(DAY, 1, start_s=start_s, clock_ppm=ppm, noise_rad=noise_rad)
    found = match_phase(track, [grid], SETTINGS)
    assert found.decision == "match"
    assert found.grid is grid
    assert found.lag_s == pytest.approx(start_s, abs=4 * found.lag_std_s)
    assert found.lag_std_s < 0.3
    assert found.clock_ppm == pytest.approx(ppm, abs=4 * found.clock_std_ppm)
    assert found.clock_std_ppm < 4
    assert found.correlation > 0.95
    assert found.search_size > 19_000
    assert found.verbal.endswith("support for this time")


@pytest.mark.parametrize("seconds", [60, 120, 300])
def test_a_clip_of_another_time_is_not_found(seconds):
    for seed in range(4):
        track, _ = hidden(ELSEWHERE, seed, start_s=500.0 + 900 * seed, seconds=seconds)
        found = match_phase(track, [hidden(DAY, seed, start_s=100.0)[1]], SETTINGS)
        assert found.decision == "no_match" if seconds > 120 else found.decision != "match"
        assert found.log10_lr_absent <= -1


def test_noise_is_no_evidence():
    """Of a clip that hardly shows the flicker, nothing is said."""
    track, grid = hidden(DAY, 5, start_s=4000.0, seconds=45, noise_rad=0.6)
    found = match_phase(track, [grid], SETTINGS)
    assert found.decision == "no_decision"
    assert abs(found.log10_lr_absent) < SETTINGS.min_log10_lr


def test_holes_on_both_sides():
    track, grid = hidden(DAY, 6, start_s=8000.4, seconds=200, hole_ratio=0.3)
    freq = grid.freq_hz.copy()
    freq[8050:8075] = np.nan
    freq[12_000:15_000] = np.nan
    found = match_phase(track, [dataclasses.replace(grid, freq_hz=freq)], SETTINGS)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(8000.4, abs=4 * found.lag_std_s)
    assert found.coverage_ratio < 0.9


def test_a_clip_of_more_holes_than_can_be_averaged():
    track, grid = hidden(DAY, 6, start_s=8000.4, seconds=120)
    every_third = np.arange(track.enf_hz.size) % 3 == 0
    track = dataclasses.replace(track, enf_hz=np.where(every_third, np.nan, track.enf_hz))
    found = match_phase(track, [grid], SETTINGS)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(8000.4, abs=4 * found.lag_std_s)


def test_a_time_in_a_gap_is_not_found_beside_it():
    track, grid = hidden(DAY, 7, start_s=8000.4)
    freq = grid.freq_hz.copy()
    freq[7900:8200] = np.nan
    found = match_phase(track, [dataclasses.replace(grid, freq_hz=freq)], SETTINGS)
    assert found.decision == "no_match"


@pytest.mark.parametrize("step_s", [0.1, 0.5, 2.0])
def test_references_of_other_steps(step_s):
    stretch = stretch_of(6000, seed=8, step_s=step_s)
    track, grid = hidden(stretch, 8, start_s=3210.4, seconds=200, clock_ppm=20.0)
    found = match_phase(track, [grid], SETTINGS)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(3210.4, abs=4 * found.lag_std_s)
    assert found.clock_ppm == pytest.approx(20.0, abs=4 * found.clock_std_ppm)


def test_a_reference_that_was_averaged():
    """Published series often are means over a window already."""
    track, grid = hidden(DAY, 9, start_s=6000.7, seconds=300, clock_ppm=70.0, noise_rad=0.003)
    smooth = np.convolve(grid.freq_hz, window_kernel(20.0, 1.0), "same")
    smooth[:20] = smooth[-20:] = np.nan
    found = match_phase(track, [dataclasses.replace(grid, freq_hz=smooth)], SETTINGS)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(6000.7, abs=0.5)
    assert found.clock_ppm == pytest.approx(70.0, abs=4 * found.clock_std_ppm)


def test_which_of_several_grids():
    track, grid = hidden(DAY, 10, start_s=3000.0)
    other = hidden(stretch_of(9000, seed=11, name="other"), 10, start_s=100.0)[1]
    found = match_phase(track, [other, grid], SETTINGS)
    alone = match_phase(track, [grid], SETTINGS)
    assert (found.decision, found.grid) == ("match", grid)
    assert found.lag_s == alone.lag_s
    assert found.search_size > alone.search_size
    assert found.candidates[0].grid == "made"
    assert match_phase(track, [other], SETTINGS).decision == "no_match"


def test_the_same_stretch_in_two_references_is_not_one_place():
    """Which of them it is can't be told, so no time in one of them stands out."""
    track, grid = hidden(DAY, 12, start_s=3000.0)
    found = match_phase(track, [grid, dataclasses.replace(grid, name="copy")], SETTINGS)
    assert found.decision == "no_decision"
    assert "several" in found.reason


@pytest.mark.parametrize(
    ("away_s", "seconds", "claim"), [(0.4, 120, "supported"), (3600.0, 120, "refuted")]
)
def test_claims(away_s, seconds, claim):
    track, grid = hidden(DAY, 13, start_s=7000.5, seconds=seconds)
    grid = dataclasses.replace(grid, t0_ns=T0_NS)
    stage = Match(grids=[grid], claimed_utc_ns=T0_NS + nanoseconds(7000.5 + away_s))
    for estimate in _estimates(track):
        stage.update(estimate)
    (result,) = stage.flush()
    assert result.claim == claim
    assert (result.claim_log10_lr > 0) == (claim == "supported")


def test_a_claim_needs_no_search():
    """A short clip that a blind search can't place may still speak for a claimed time."""
    supported = 0
    for seed in range(6):
        track, grid = hidden(DAY, 20 + seed, start_s=2000.0 + 2500 * seed, seconds=60)
        claimed_ns = T0_NS + nanoseconds(2000.0 + 2500 * seed)
        found = match_phase(track, [dataclasses.replace(grid, t0_ns=T0_NS)], SETTINGS, claimed_ns)
        assert found.claim_log10_lr >= found.log10_lr_absent - 1e-9
        supported += found.claim_log10_lr > SETTINGS.min_log10_lr
    assert supported >= 5


def test_estimates_without_a_phase_are_compared_by_correlation():
    clip = clip_of(DAY.freq_hz, 4000.5, 240, 1)
    stage = Match(grids=[hidden(DAY, 1, start_s=100.0)[1]])
    for estimate in estimates_from(clip):
        stage.update(estimate)
    (result,) = stage.flush()
    assert (result.method, result.decision) == ("ncc", "match")
    assert any("carry no phase" in warning for warning in result.warnings)


def test_ratios_are_no_larger_than_the_calibration_can_vouch_for():
    track, grid = hidden(DAY, 1, start_s=2345.25, seconds=300, noise_rad=0.001)
    found = match_phase(track, [grid], SETTINGS)
    assert found.log10_lr == calibration().other.limit
    assert found.log10_lr_absent == calibration().absent.limit
    line = CalibrationLine(0.5, -0.25, 2.0)
    assert [line(v) for v in (-100.0, 1.0, 100.0)] == [-2.0, 0.25, 2.0]
    assert np.isnan(line(np.nan))


def _estimates(track):
    """Messages of a track with phases."""
    out = []
    for i, plain in enumerate(estimates_from(track)):
        amplitude = 10.0 * np.exp(1j * track.phase_rad[i])
        var = np.array([track.phase_var_rad2[i] * 100.0])
        out.append(
            dataclasses.replace(
                plain,
                carrier_hz=2 * track.nominal_hz,
                points=1,
                amplitude_pts_ns=np.array([(plain.start_pts_ns + plain.end_pts_ns) // 2]),
                amplitude_re=np.array([amplitude.real]),
                amplitude_im=np.array([amplitude.imag]),
                amplitude_var_re=var,
                amplitude_var_im=var,
                amplitude_cov=np.zeros(1),
            )
        )
    return out


def test_slips_of_whole_turns_are_no_evidence():
    """An estimator that loses count of the turns makes every grid look wrong, so none is right."""
    for seed in range(3):
        track, _ = hidden(ELSEWHERE, seed, start_s=900.0 + 900 * seed, seconds=120, noise_rad=0.2)
        wrong = np.where(np.arange(track.enf_hz.size) % 10 == 5, 0.45, 0.0)
        slipping = dataclasses.replace(track, enf_hz=track.enf_hz + wrong)
        found = match_phase(slipping, [hidden(DAY, seed, start_s=100.0)[1]], SETTINGS)
        assert found.decision != "match"
        assert found.log10_lr_absent < 1
