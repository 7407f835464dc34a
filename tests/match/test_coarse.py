"""The quick look at all lags against the plain loop, in pieces and at every pair of steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.match import MatchSettings, ncc
from rsenf.match import score as scoring
from rsenf.match.series import Track
from tests.match.match_clips import grid_from, wandering_grid
from tests.oracle.all_lags import all_lags

SETTINGS = MatchSettings(min_seconds=4.0)
EVERY = 10**9


def pair(step_s, seed, *, holes=0.1, gaps=True, cut=0, hops=150, clip_hops=20):
    """A clip of hops of a second, and a reference of another step that holds it."""
    rng = np.random.default_rng(seed)
    fine = np.repeat(wandering_grid(hops, seed), 10) + 1e-3 * rng.standard_normal(10 * hops)
    freq_hz = fine.reshape(-1, round(10 * step_s)).mean(axis=1)
    if gaps:
        freq_hz[rng.random(freq_hz.size) < 0.03] = np.nan
        third = freq_hz.size // 3
        freq_hz[third : third + round(25 / step_s)] = np.nan
    enf_hz = fine.reshape(-1, 10).mean(axis=1)[90 : 90 + clip_hops]
    enf_hz = enf_hz + 5e-4 * rng.standard_normal(clip_hops)
    enf_hz[rng.random(clip_hops) < holes] = np.nan
    track = Track(0.5, 1.0, 1.0, enf_hz, np.full(clip_hops, 1e-6), 50.0)
    return track, grid_from(freq_hz[: freq_hz.size - cut], step_s=step_s)


def looked_at_plainly(track, grid):
    return all_lags(
        track.enf_hz, track.first_s, track.hop_s, track.nominal_hz, grid,
        least_s=max(SETTINGS.min_overlap * track.usable * track.hop_s, SETTINGS.min_seconds),
        clock_scale_ppm=SETTINGS.clock_scale_ppm,
    )  # fmt: skip


@pytest.fixture(params=[40, 70, 1 << 20], ids=["small pieces", "pieces", "one piece"])
def piece(request, monkeypatch):
    """Samples of a reference at a time, down to hardly more than a clip's."""
    monkeypatch.setattr(scoring, "PIECE", request.param)
    monkeypatch.setattr(ncc, "MIN_FFT", min(request.param, ncc.MIN_FFT))


@pytest.mark.usefixtures("piece")
@pytest.mark.parametrize(
    ("step_s", "holes", "gaps", "cut"),
    [(1.0, 0.1, True, 0), (1.0, 0.1, False, 0), (1.0, 0.0, True, 0), (1.0, 0.0, False, 0),
     (0.1, 0.1, True, 7), (0.5, 0.0, True, 1), (2.0, 0.1, True, 0), (5.0, 0.0, False, 0)],
)  # fmt: skip
def test_every_lag_is_looked_at_once_and_scored_as_by_the_loop(
    step_s, holes, gaps, cut, monkeypatch
):
    monkeypatch.setattr(scoring, "STRETCH_S", 0.0)  # every lag is a place of its own
    track, grid = pair(step_s, 3, holes=holes, gaps=gaps, cut=cut)
    expected = looked_at_plainly(track, grid)
    scored = sorted((lag_s, score) for lag_s, score, _ in expected if score is not None)
    found = scoring.survey(track, grid, SETTINGS, EVERY)
    assert found.lags == len(scored)
    assert found.possible == sum(inside for *_, inside in expected)
    assert found.inside == sum(inside for _, score, inside in expected if score is not None)
    assert (np.diff(found.score) <= 0).all()
    order = np.argsort(found.lag_s)
    lag_s, score = np.array(scored).T
    np.testing.assert_allclose(found.lag_s[order], lag_s, atol=1e-9)
    np.testing.assert_allclose(found.score[order], score, atol=1e-6)


@pytest.mark.usefixtures("piece")
def test_the_best_of_each_stretch_is_kept_and_of_those_the_best():
    track, grid = pair(1.0, 5)
    expected = [(lag_s, score) for lag_s, score, _ in looked_at_plainly(track, grid) if score]
    found = scoring.survey(track, grid, SETTINGS, 6)
    assert found.score.size == 6
    best_s, best = max(expected, key=lambda lag: lag[1])
    assert found.lag_s[0] == pytest.approx(best_s)
    assert found.score[0] == pytest.approx(best, abs=1e-6)
    scores = dict(expected)
    assert [scores[lag_s] for lag_s in found.lag_s] == pytest.approx(list(found.score), abs=1e-6)
    for lag_s, score in expected:
        nearest_s = np.abs(found.lag_s - lag_s).min()
        assert score <= found.score[-1] + 1e-6 or nearest_s < scoring.STRETCH_S


def test_the_list_stays_short_however_long_the_reference(monkeypatch):
    """What is kept after each stretch of the reference doesn't grow with it."""
    longest = []
    best = scoring._best
    monkeypatch.setattr(
        scoring, "_best", lambda lag_s, *rest: longest.append(lag_s.size) or best(lag_s, *rest)
    )
    monkeypatch.setattr(scoring, "PIECE", 1000)
    monkeypatch.setattr(ncc, "MIN_FFT", 1)
    track, _ = pair(1.0, 7)
    scoring.survey(track, grid_from(wandering_grid(20_000, 7)), SETTINGS, 4)
    assert len(longest) > 2
    assert max(longest) < 200


@pytest.mark.parametrize("seed", range(4))
def test_a_clip_that_runs_into_a_gap_comes_first_all_the_same(seed):
    """However many wrong times have no gap."""
    freq_hz = wandering_grid(20_000, 30 + seed)
    rng = np.random.default_rng(seed)
    enf_hz = freq_hz[9000:9120] + 3e-4 * rng.standard_normal(120)
    freq_hz[9070:9300] = np.nan
    track = Track(0.5, 1.0, 1.0, enf_hz, np.full(120, 1e-7), 50.0)
    found = scoring.survey(track, grid_from(freq_hz), MatchSettings(), 8)
    assert found.lag_s[0] == pytest.approx(9000.0)


class OnDisk:
    """A reference that is read in slices, none longer than allowed."""

    def __init__(self, freq_hz, longest):
        self._freq_hz, self.size, self._longest = freq_hz, freq_hz.size, longest

    def __getitem__(self, part):
        assert part.stop - part.start <= self._longest
        return self._freq_hz[part]


@pytest.mark.parametrize("step_s", [0.1, 1.0, 2.0])
def test_a_reference_on_disk_is_read_piece_by_piece(step_s, monkeypatch):
    monkeypatch.setattr(scoring, "PIECE", 60)
    track, grid = pair(step_s, 11)
    on_disk = replace(grid, freq_hz=OnDisk(grid.freq_hz, longest=60 + round(25 / step_s)))
    expected, found = (scoring.survey(track, g, SETTINGS) for g in (grid, on_disk))
    np.testing.assert_array_equal(found.lag_s, expected.lag_s)
    np.testing.assert_array_equal(found.score, expected.score)


@pytest.mark.parametrize(("step_s", "gaps"), [(1.0, False), (1.0, True), (0.5, True)])
def test_a_long_reference_is_searched_from_means_to_every_lag(step_s, gaps, monkeypatch):
    """It keeps the same best lags, with the same scores, as a search of every lag."""
    rng = np.random.default_rng(21)
    fine = wandering_grid(60_000, 22)
    enf_hz = fine[40_003:40_203] + 1e-3 * rng.standard_normal(200)
    enf_hz[rng.random(200) < 0.1] = np.nan
    track = Track(0.5, 1.0, 1.0, enf_hz, np.full(200, 1e-6), 50.0)
    freq_hz = np.repeat(fine, round(1.0 / step_s))
    if gaps:
        freq_hz[rng.random(freq_hz.size) < 0.2] = np.nan
        freq_hz[round(40_050 / step_s) : round(40_080 / step_s)] = np.nan
    grid = grid_from(freq_hz, step_s=step_s)
    plain = scoring.survey(track, grid, SETTINGS, 200)
    monkeypatch.setattr(scoring, "PIECE", 10_000)
    coarse = scoring.survey(track, grid, SETTINGS, 200)
    assert coarse.lag_s[0] == plain.lag_s[0] == pytest.approx(40_003.0)
    assert coarse.score[0] == pytest.approx(plain.score[0], abs=1e-6)
    assert coarse.inside / coarse.possible == pytest.approx(plain.inside / plain.possible, abs=0.02)
    assert coarse.lags == pytest.approx(plain.lags, rel=0.02)
    # Of the best wrong places, too, most are found; one at a lag has the score of that lag.
    apart_s = np.abs(plain.lag_s[:20, None] - coarse.lag_s).min(axis=1)
    assert np.mean(apart_s <= scoring.STRETCH_S) >= 0.9
    scores = dict(zip(plain.lag_s.tolist(), plain.score.tolist(), strict=True))
    both = [i for i, lag_s in enumerate(coarse.lag_s.tolist()) if lag_s in scores]
    assert len(both) > 20
    expected = [scores[coarse.lag_s[i]] for i in both]
    np.testing.assert_allclose(coarse.score[both], expected, atol=1e-6)


def test_steps_that_do_not_fit_are_refused():
    track, grid = pair(1.0, 9)
    with pytest.raises(UsageError, match="no whole multiple"):
        scoring.survey(track, replace(grid, step_s=0.7), SETTINGS)


def test_a_reference_without_a_value_has_no_lag():
    track, grid = pair(1.0, 9)
    empty = replace(grid, freq_hz=np.full(grid.freq_hz.size, np.nan))
    found = scoring.survey(track, empty, SETTINGS)
    assert (found.lags, found.inside, found.score.size) == (0, 0, 0)
    assert found.possible > 0
