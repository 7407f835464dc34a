"""Trials: what is true, false and none, and a film tried from its rows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from rsenf.bench.measure import Filmed
from rsenf.bench.recording_time import PlannedFilm, trials
from rsenf.bench.recording_time.trials import METHODS, _grid_path, _judged
from rsenf.bench.scenes import Setting
from rsenf.match.stage import METHODS as MATCH_METHODS
from rsenf.messages import Header, MatchResult
from rsenf.model import GridPath, simulate_rows
from rsenf.rows.stage import blocks_from_luminance

FILM = PlannedFilm("still", 0, "led", 6, "240p", 62.0, 3 * 3600.0, ("lossless",))


def judged(decision: str, lag_s: float, true_lag_s: float = 100.0) -> dict[str, Any]:
    said = MatchResult(decision=decision, lag_s=lag_s, clock_ppm=12.0, lag_std_s=0.1)
    return _judged(true_lag_s, 10.0, [said])


@pytest.mark.parametrize(
    ("decision", "lag_s", "true_lag_s", "outcome"),
    [
        ("match", 101.0, 100.0, "true"),
        ("match", 98.99, 100.0, "false"),
        ("match", 100.0, math.nan, "false"),  # the true time isn't in the reference
        ("match", math.nan, 100.0, "false"),
        ("no_decision", 100.0, 100.0, "none"),
        ("no_match", 100.0, math.nan, "none"),
    ],
)
def test_outcomes(decision: str, lag_s: float, true_lag_s: float, outcome: str) -> None:
    assert judged(decision, lag_s, true_lag_s)["outcome"] == outcome


def test_errors_are_kept_whatever_was_decided() -> None:
    found = judged("no_decision", 100.3)
    assert found["lag_error_s"] == pytest.approx(0.3)
    assert found["clock_error_ppm"] == pytest.approx(2.0)
    assert found["nearest"]
    assert found["log10_lr"] is None
    assert judged("match", 100.3, math.nan)["lag_error_s"] is None


def test_methods_are_those_there_are() -> None:
    assert set(METHODS) <= set(MATCH_METHODS)


START_S = 1234.5


@pytest.fixture(scope="module")
def record() -> dict[str, Any]:
    """A film whose rows are simulated, without pixels; it begins at START_S."""

    def simulated(
        setting: Setting, grid: GridPath, duration_s: float, codings: tuple[str, ...]
    ) -> Filmed:
        at_start = GridPath(grid.freq_hz, grid.step_s, START_S, grid.nominal_hz)
        rows = simulate_rows(setting.model, at_start, duration_s, setting.seed, strips=2)
        blocks = list(blocks_from_luminance(rows.level, rows.frame_time_s, Header()))
        return Filmed(rows.truth, dict.fromkeys(codings, blocks), {})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trials, "filmed_of", simulated)
        patch.setattr(trials, "METHODS", ("ncc", "phase"))
        return trials.run_trials(FILM, None)


def test_a_clean_clip_is_found_where_it_was_made(record: dict[str, Any]) -> None:
    found = {(t["trial"], t["method"]): t for t in record["trials"]}
    assert {trial for trial, _ in found} == {"present", "same_day", "other_day"}
    assert found["present", "phase"]["outcome"] == "true"
    assert abs(found["present", "phase"]["lag_error_s"]) < 0.5
    assert abs(found["present", "phase"]["clock_error_ppm"]) < 10
    for trial in ("same_day", "other_day"):
        assert found[trial, "phase"]["outcome"] == "none"
        assert found[trial, "phase"]["lag_error_s"] is None


def test_the_record_says_what_it_is_of(record: dict[str, Any]) -> None:
    assert (record["kind"], record["lamp"], record["seed"]) == ("still", "led", 6)
    assert {(t["coding"], t["length_s"]) for t in record["trials"]} == {("lossless", 60.0)}


def test_a_film_has_its_own_time_in_the_day() -> None:
    start_s = _grid_path(FILM, None).start_s
    assert start_s == _grid_path(FILM, None).start_s
    assert 0 <= start_s < FILM.reference_s - FILM.duration_s
    assert start_s != _grid_path(replace(FILM, seed=7), None).start_s
