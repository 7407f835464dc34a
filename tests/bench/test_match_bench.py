"""The bench of long searches: what is searched is what it says, and a trial from end to end."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rsenf.bench.match_days import (
    DAY_S,
    FIRST_S,
    GRID,
    REFERENCE_HZ,
    RUN,
    RUNS,
    Haystack,
    _like,
    clip_of,
    lag_by_lag,
    loop_cpu_s,
    real_day,
    write_haystack,
)
from rsenf.bench.match_trial import _searches, _tabulated, _text, _timed_stream
from rsenf.cli import main
from rsenf.match import MatchSettings
from rsenf.match.ncc import Residuals, lag_residuals
from rsenf.match.phase import match_phase
from rsenf.match.series import Grid
from rsenf.messages.schema import FloatArray
from rsenf.reference import open_reference
from rsenf.timebase import seconds
from tests.bench.bench_records import run_in

THREE_DAYS = Haystack(days=3, gaps=True, clip_s=200, seed=3, folder=None)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    store = tmp_path_factory.mktemp("store")
    write_haystack(THREE_DAYS, store)
    reference = open_reference(f"store:{GRID}", store=store)
    # The store doesn't keep a gap that it would begin with.
    before = round(seconds(reference.t0_ns) - FIRST_S)
    return np.concatenate([np.full(before, np.nan), reference.freq_hz])


def test_the_middle_day_is_the_real_one_and_the_others_are_not(stored: np.ndarray) -> None:
    real = real_day(None, THREE_DAYS.seed).freq_hz
    days = [stored[k * DAY_S : (k + 1) * DAY_S] for k in range(stored.size // DAY_S)]
    away = [np.nanstd(day - real) for day in days[:2]]
    assert away[1] == pytest.approx(REFERENCE_HZ, rel=0.1)
    assert away[0] > 5e-3


def test_gaps_are_there_and_one_in_the_clip(stored: np.ndarray) -> None:
    missing = np.isnan(stored)
    assert 0.15 < missing.mean() < 0.45
    start = int(THREE_DAYS.clip_start_s)
    assert missing[start : start + 200].mean() == pytest.approx(0.2, abs=0.01)


def test_the_clip_is_of_the_time_that_it_says(stored: np.ndarray) -> None:
    track = clip_of(THREE_DAYS)
    start = round(THREE_DAYS.clip_start_s)
    beside = stored[start : start + 200] - track.enf_hz
    assert np.nanstd(beside) < 4e-3
    assert np.nanstd(stored[start + 500 : start + 700] - track.enf_hz) > 6e-3


def test_a_day_like_another_has_its_spectrum_and_none_of_its_times() -> None:
    day = real_day(None, 1).freq_hz
    other = _like(day, np.random.default_rng(2))
    assert other.mean() == pytest.approx(day.mean())
    assert other.std() == pytest.approx(day.std(), rel=1e-6)
    assert np.diff(other).std() == pytest.approx(np.diff(day).std(), rel=0.1)
    assert abs(np.corrcoef(day, other)[0, 1]) < 0.3


def test_the_loop_compares_every_lag_as_the_search_does() -> None:
    rng = np.random.default_rng(3)
    x, y = 50.0 + 0.01 * rng.standard_normal((2, 700))
    x, y = x[:90], np.where(rng.random(700) < 0.2, np.nan, y)
    x[7:20] = np.nan
    loop = lag_by_lag(x, y, 1 - x.size, x.size + y.size - 1, 30)
    table = list(lag_residuals(x, np.isfinite(x), y, np.isfinite(y), min_pairs=30))
    assert np.array_equal(loop.pairs, np.concatenate([t.pairs for t in table]))
    for name in ("offset", "residual_var"):
        found = np.concatenate([getattr(t, name) for t in table])
        assert np.allclose(found, getattr(loop, name), rtol=1e-9, atol=1e-14, equal_nan=True)


def test_a_search_with_the_loop_in_it_ends_with_the_same_verdict(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    day, track = real_day(None, THREE_DAYS.seed).freq_hz, clip_of(THREE_DAYS)
    begin = int(THREE_DAYS.clip_start_s % DAY_S) - 2000
    freq_hz = day[begin : begin + 5000].copy()
    freq_hz[4000:4300] = np.nan
    grid = Grid("part", 50.0, 0, 1.0, freq_hz)
    found = match_phase(track, [grid], MatchSettings())

    def looped(
        x: FloatArray, x_ok: object, y: FloatArray, y_ok: object, *, min_pairs: int, lags: object
    ) -> Iterator[Residuals]:
        yield lag_by_lag(x, y, 1 - x.size, x.size + y.size - 1, min_pairs)

    monkeypatch.setattr("rsenf.match.score.lag_residuals", looped)
    assert match_phase(track, [grid], MatchSettings()) == found
    assert found.decision == "match"


def test_a_trial_is_measured_once_and_makes_a_table(tmp_path: Path) -> None:
    haystacks = [Haystack(1, True, 120, 4, None)]
    begun: list[str] = []
    run = run_in(tmp_path, begun.append)
    records, again = (_searches(run, haystacks, 2) for _ in range(2))
    assert len(begun) == 1
    assert again == records
    stream = {"clip_s": 7200, "results": 3, "matches": 2, "coming_cpu_s": 1.0, "cpu_s": 3.6,
              "peak_mb": None}  # fmt: skip
    document = _tabulated(records, [stream])
    (row,) = json.loads(json.dumps(document, allow_nan=False))["rows"]
    assert row["right"] == 2
    assert row["worst_error_s"] < 1.0
    assert row["clip_in_reference_ratio"] == pytest.approx(0.8, abs=0.06)
    assert set(row["cpu_s"]) == {"search", "lags", "loop", "whole_loop", "correlate"}
    assert min(row["cpu_s"].values()) > 0.0
    assert row["loop_over_lags"] > row["loop_over_search"] > 1
    assert "a day" in _text(document)
    assert _text(document, on_page=True).startswith("**Searches**\n\n| reference |")
    assert "| 2 h | 3 | 2 | 3.60 s | 2.60 s | 0.50 |" in _text(document, on_page=True)


def test_a_loop_is_scaled_from_the_lags_that_were_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter((3.0, 5.0))
    monkeypatch.setattr(time, "process_time", lambda: next(clock))
    reference_hz, lags = np.full(3 * RUN, 50.0), 5 * RUN * RUNS
    assert loop_cpu_s(np.full(10, 50.0), reference_hz, lags, 5, seed=1) == pytest.approx(10.0)


def test_a_clip_that_comes_in_is_matched_on_the_way() -> None:
    record = _timed_stream(130, 4, None)
    assert (record["results"], record["matches"]) == (3, 3)
    assert 0 < record["coming_cpu_s"] < record["cpu_s"]


def test_a_clip_longer_than_a_day_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "match", "--duration-s", "90000"]) == 2
    assert "at most" in capsys.readouterr().err
