"""Trials: what is true, false and none, and a whole film tried from its rows."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from rsenf.bench.recording_time import Film
from rsenf.bench.recording_time.trials import (
    METHODS,
    Cuts,
    _judged,
    known_methods,
    run_trials,
)
from rsenf.match.stage import METHODS as MATCH_METHODS
from rsenf.messages import MatchResult
from tests.bench.film_records import START_S, keep_simulated

FILM = Film("still", 0, "led", 6, "240p", 62.0, 3 * 3600.0, ("lossless",))


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
    assert set(known_methods()) == set(METHODS) & set(MATCH_METHODS)
    assert "phase" in known_methods()


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder: Path = tmp_path_factory.mktemp("films")
    keep_simulated(FILM, folder)
    return run_trials(Cuts(FILM, "lossless", 60.0, ("ncc", "phase"), 0.3e-3), folder, None)


def test_a_clean_clip_is_found_where_it_was_made(record: dict[str, Any]) -> None:
    trials = {(t["trial"], t["method"]): t for t in record["trials"]}
    assert {trial for trial, _ in trials} == {"present", "same_day", "other_day"}
    assert trials["present", "phase"]["outcome"] == "true"
    assert abs(trials["present", "phase"]["lag_error_s"]) < 0.5
    assert abs(trials["present", "phase"]["clock_error_ppm"]) < 10
    for trial in ("same_day", "other_day"):
        assert trials[trial, "phase"]["outcome"] == "none"
        assert trials[trial, "phase"]["lag_error_s"] is None


def test_the_record_says_what_it_is_of(record: dict[str, Any]) -> None:
    assert record["key"].startswith(FILM.key)
    assert (record["coding"], record["length_s"], record["kind"]) == ("lossless", 60.0, "still")
    assert record["versions"]["film"] == "test"
    assert START_S > 0
