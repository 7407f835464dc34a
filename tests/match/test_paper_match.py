"""The paper's whole procedure: rows in, a time of recording out, present and absent."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.match import Match, MatchSettings, hypotheses_of, metric, paper_search, tracker_for
from rsenf.messages import Header
from rsenf.model import CaptureModel, GridPath, Scene, Shutter, parse_frame_rate, simulate_rows
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker
from tests.match.match_clips import blocks_from, clip_of, estimates_from, grid_from, wandering_grid

REFERENCE_S = 3600
START_S = 1234.4
CLIP_S = 90.0


# Of two frame rates the nominal illumination frequency is a multiple: every line is then two tones,
# mirrored about it, beside what is left of the texture. On a grid within some 30 mHz of its nominal
# frequency they share one peak, and the lag may be seconds off; so this one stays clear of it.
CASES = [("29.97", 50.0), ("25", 50.08), ("23.976", 60.0), ("30", 60.08)]


@functools.cache
def reference_hz(grid_hz, seed=7):
    return wandering_grid(REFERENCE_S, seed, grid_hz)


@functools.cache
def estimates_at(rate, grid_hz, seed=1):
    """Hypotheses of a clip of a lightly textured wall, by the tracker."""
    nominal_hz = float(round(grid_hz))
    model = CaptureModel(
        shutter=Shutter(frame_rate=parse_frame_rate(rate), rows=48, columns=64, idle_ratio=0.2),
        scene=Scene(texture_ratio=0.02),
    ).with_effect("exposure", exposure_s=1 / 1000)
    path = GridPath(reference_hz(grid_hz), 1.0, START_S, nominal_hz)
    rows = simulate_rows(model, path, CLIP_S, seed)
    stage = make_tracker(TrackSettings(method="paper", nominal_hz=nominal_hz))
    blocks = blocks_from_luminance(rows.level, rows.frame_time_s, Header(source="site/cam"))
    return [e for b in blocks for e in stage.update(b)] + stage.flush()


def searched(rate, grid_hz, *, seed=7, **settings):
    """The clip searched for in its own grid, or in another."""
    grid = grid_from(reference_hz(grid_hz, seed), nominal_hz=float(round(grid_hz)))
    return paper_search(hypotheses_of(estimates_at(rate, grid_hz)), grid, MatchSettings(**settings))


def run(messages, method="metric3", **settings):
    stage = Match(method=method, **settings)
    return [r for m in messages for r in stage.update(m)] + stage.flush()


@pytest.mark.parametrize(("rate", "grid_hz"), CASES)
def test_a_recording_is_found_where_it_was_made(rate, grid_hz):
    tally = searched(rate, grid_hz)
    for number in (3, 4):
        found = metric(tally, number)
        assert found.decision == "match"
        assert abs(found.lag_s - START_S) <= 1.0
        assert found.correlation > 0.94
        assert 0.0 <= found.idle_ratio <= 0.95


@pytest.mark.parametrize(("rate", "grid_hz"), CASES)
def test_where_it_was_not_made_the_correlation_is_lower(rate, grid_hz):
    """Whether it stays below the threshold of 0.94 is luck, which the metrics can't help."""
    here = metric(searched(rate, grid_hz), 3)
    away = metric(searched(rate, grid_hz, seed=8, threshold_correlation=0.9999), 3)
    assert (away.decision, away.verbal) == ("no_decision", "")
    assert away.correlation < here.correlation


@pytest.mark.parametrize("method", ["metric1", "metric2", "metric3", "metric4"])
def test_the_stage_says_what_the_library_does(method):
    estimates, grid = estimates_at("29.97", 50.0), grid_from(reference_hz(50.0))
    (result,) = run([*blocks_from(grid), *estimates], method)
    tally = paper_search(hypotheses_of(estimates), grid, MatchSettings())
    found = metric(tally, int(method[-1]))
    assert (result.decision, result.reason) == (found.decision, found.reason)
    assert (result.lag_s, result.correlation) == (found.lag_s, found.correlation)
    assert (result.idle_ratio, result.search_size) == (found.idle_ratio, found.search_size)
    assert result.method == method
    assert result.final
    assert np.isnan(result.log10_lr)
    assert any("no likelihood ratio" in w for w in result.warnings)
    assert tracker_for(method) == "paper"


def test_a_claim_is_held_against_the_lag():
    t0_ns = 10**18
    grid = grid_from(reference_hz(50.0), t0_ns=t0_ns)
    for away_s, claim in ((0.3, "supported"), (-60.0, "refuted")):
        claimed_ns = t0_ns + round((START_S + away_s) * 1e9)
        messages = [*blocks_from(grid), *estimates_at("29.97", 50.0)]
        (result,) = run(messages, "metric4", claimed_utc_ns=claimed_ns)
        assert result.claim == claim


def test_interim_results_rest_on_whole_windows():
    messages = [*blocks_from(grid_from(reference_hz(50.0))), *estimates_at("29.97", 50.0)]
    results = run(messages, "metric4", interim_every_s=30.0)
    assert [r.final for r in results] == [False, False, False, True]
    # Windows of 20 s that end by 30, 60 and 90 s.
    assert "only 11 usable seconds" in results[0].reason
    assert [r.seconds_used for r in results[1:]] == [41.0, 71.0, 71.0]


def test_a_new_epoch_is_another_clip():
    first = estimates_at("29.97", 50.0)
    again = [dataclasses.replace(e, header=dataclasses.replace(e.header, epoch=1)) for e in first]
    results = run([*blocks_from(grid_from(reference_hz(50.0))), *first, *again], "metric3")
    assert [r.header.epoch for r in results] == [0, 1]
    one, other = results
    assert (one.lag_s, one.correlation) == (other.lag_s, other.correlation)
    assert one.search_size == other.search_size


def test_gaps_of_the_reference_are_left_out():
    freq_hz = reference_hz(50.0).copy()
    freq_hz[1300:1310] = np.nan
    freq_hz[2000:2400] = np.nan
    whole, gappy = (
        metric(
            paper_search(hypotheses_of(estimates_at("29.97", 50.0)), grid_from(f), MatchSettings()),
            3,
        )
        for f in (reference_hz(50.0), freq_hz)
    )
    assert gappy.decision == "match"
    assert abs(gappy.lag_s - START_S) <= 1.0
    assert gappy.seconds_used < whole.seconds_used
    assert gappy.search_size < whole.search_size


def test_a_reference_of_two_seconds_is_met_by_every_other_estimate():
    coarse = reference_hz(50.0).reshape(-1, 2).mean(axis=1)
    hypotheses = hypotheses_of(estimates_at("29.97", 50.0))
    found = metric(paper_search(hypotheses, grid_from(coarse, step_s=2.0), MatchSettings()), 3)
    assert found.decision == "match"
    assert abs(found.lag_s - START_S) <= 1.0
    assert found.correlation > 0.99


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda es: es[: 161 * 20], "only 20 usable seconds"),
        (lambda es: [dataclasses.replace(e, nominal_hz=60.0) for e in es], "of a 60 Hz grid"),
        (
            lambda es: [
                dataclasses.replace(e, usable=False, reason="dark") for e in es if e.rank == 0
            ],
            "no usable signal: dark",
        ),
        (lambda es: [], "shorter than one window"),
    ],
)
def test_what_cannot_be_decided_says_why(change, reason):
    messages = [*blocks_from(grid_from(reference_hz(50.0))), *change(estimates_at("29.97", 50.0))]
    (result,) = run(messages)
    assert result.decision == "no_decision"
    assert reason in result.reason
    assert np.isnan(result.lag_s)


def test_another_trackers_estimates_are_not_hypotheses():
    freq_hz = reference_hz(50.0)
    estimates = estimates_from(clip_of(freq_hz, START_S, 200, 1))
    (result,) = run([*blocks_from(grid_from(freq_hz)), *estimates], "metric4")
    assert result.decision == "no_decision"
    assert "metric4 compares the hypotheses of 'paper', not an ENF by 'stft'" in result.reason
    assert tracker_for("phase") == tracker_for("no such") == ""


def test_no_flicker_is_mentioned():
    rng = np.random.default_rng(1)
    level = (100 + rng.normal(0, 1, (1800, 12, 1))).astype(np.float32)
    stage = make_tracker(TrackSettings(method="paper", nominal_hz=50.0))
    blocks = blocks_from_luminance(level, np.arange(1800) / 30.0, Header(source="site/cam"))
    estimates = [e for b in blocks for e in stage.update(b)] + stage.flush()
    (result,) = run([*blocks_from(grid_from(reference_hz(50.0))), *estimates])
    assert any("no mains flicker stands out" in w for w in result.warnings)


def test_several_references_are_refused():
    grids = [
        dataclasses.replace(grid_from(reference_hz(50.0, seed)), name=f"g{seed}") for seed in (1, 2)
    ]
    with pytest.raises(UsageError, match="one reference, not 2"):
        run(estimates_at("29.97", 50.0), grids=grids)


def test_a_threshold_that_no_correlation_has_is_refused():
    with pytest.raises(UsageError, match="threshold"):
        MatchSettings(threshold_correlation=94)
