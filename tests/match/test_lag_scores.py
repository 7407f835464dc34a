"""The curve of scores against lag says what the matcher says, at the lag that it found."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.match import MatchSettings
from rsenf.match.correlate import lag_scores, match_ncc
from tests.match.match_clips import clip_of, grid_from, wandering_grid

DAY = wandering_grid(20_000, seed=7)
SETTINGS = MatchSettings()


def whole_curve(track, grid, best_lag_s):
    pieces = list(lag_scores(track, grid, SETTINGS, best_lag_s))
    assert {(p.name, p.unit) for p in pieces} == {("correlation", "1 is perfect")}
    assert all((np.diff(p.lag_s) > 0).all() for p in pieces)
    lag_s = np.concatenate([p.lag_s for p in pieces])
    return lag_s, np.concatenate([p.score for p in pieces])


@pytest.mark.parametrize(("window_s", "step_s"), [(20.0, 1.0), (1.0, 1.0), (1.0, 2.0)])
def test_the_curve_has_its_top_at_the_match_and_covers_the_search(window_s, step_s):
    freq_hz = DAY if step_s == 1.0 else DAY.reshape(-1, 2).mean(axis=1)
    track = clip_of(DAY, 9876.0, 300, 2, window_s=window_s)
    grid = grid_from(freq_hz, step_s=step_s)
    found = match_ncc(track, grid, SETTINGS)
    assert found.decision == "match"
    lag_s, score = whole_curve(track, grid, found.lag_s)
    best = int(np.nanargmax(score))
    assert lag_s[best] == pytest.approx(found.lag_s, abs=1.0)
    assert score[best] == pytest.approx(found.correlation, abs=2e-3)
    assert np.isfinite(score).sum() == found.search_size


def test_gaps_of_the_reference_are_gaps_of_the_curve():
    freq_hz = DAY.copy()
    freq_hz[12_000:13_000] = np.nan
    track = clip_of(DAY, 5000.0, 200, 3)
    grid = grid_from(freq_hz)
    lag_s, score = whole_curve(track, grid, 5000.0)
    assert np.isnan(score[(lag_s > 12_000) & (lag_s < 12_800)]).all()


@pytest.mark.parametrize(("window_s", "step_s"), [(20.0, 1.0), (1.0, 1.0), (1.0, 2.0), (1.0, 0.5)])
def test_a_reference_in_parts_gives_the_same_curve(window_s, step_s, monkeypatch):
    """What is cut for the sake of memory shows nowhere."""
    shape = {2.0: lambda f: f.reshape(-1, 2).mean(axis=1), 0.5: lambda f: np.repeat(f, 2)}
    freq_hz = shape.get(step_s, lambda f: f)(DAY[:6000])
    track, grid = clip_of(DAY, 4321.0, 200, 2, window_s=window_s), grid_from(freq_hz, step_s=step_s)
    lag_s, score = whole_curve(track, grid, 4321.0)
    monkeypatch.setattr("rsenf.match.correlate.PIECE", 1000)
    parts_s, parts = whole_curve(track, grid, 4321.0)
    order, parts_order = np.argsort(lag_s, kind="stable"), np.argsort(parts_s, kind="stable")
    assert parts_s[parts_order] == pytest.approx(lag_s[order], abs=1e-6)
    assert parts[parts_order] == pytest.approx(score[order], abs=1e-6, nan_ok=True)
