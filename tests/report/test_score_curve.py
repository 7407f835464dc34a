"""A curve cut down to a picture's width, against a slow sort into stretches."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest

from rsenf.match.correlate import LagScores
from rsenf.report.score_curve import NEAR_S, WHOLE_POINTS, no_curve, score_curve


def piece(lag_s: np.ndarray, score: np.ndarray) -> LagScores:
    return LagScores(lag_s, score, "correlation", "1 is perfect")


def scores(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.where(rng.random(count) < 0.02, np.nan, rng.normal(size=count))


def slow(lag_s: np.ndarray, score: np.ndarray, first_s: float, last_s: float) -> dict:
    """Least and greatest of each stretch, one lag after the other."""
    out: dict[int, list[float]] = {}
    for lag, value in zip(lag_s, score, strict=True):
        place = int((lag - first_s) / (last_s - first_s) * WHOLE_POINTS)
        out.setdefault(min(max(place, 0), WHOLE_POINTS - 1), []).append(value)
    return out


def test_pieces_in_any_order_give_each_stretch_its_extremes() -> None:
    lag_s, score = np.arange(-50.0, 20_000.0), scores(20_050, 1)
    parts = np.array_split(np.arange(lag_s.size), 7)
    pieces = [piece(lag_s[p], score[p]) for p in parts[::-1]]
    curve = score_curve(pieces, -50.0, 20_000.0, 777.0)
    expected = slow(lag_s, score, -50.0, 20_000.0)
    assert curve.lag_s.size == len(expected)
    for k, (low, high) in enumerate(zip(curve.low, curve.high, strict=True)):
        assert low == np.nanmin(expected[k])
        assert high == np.nanmax(expected[k])
    assert (np.diff(curve.lag_s) > 0).all()
    assert (curve.name, curve.unit) == ("correlation", "1 is perfect")


def test_every_lag_near_the_best_is_kept_in_order() -> None:
    lag_s = np.arange(0.0, 5000.0)
    score = scores(5000, 2)
    odd, even = piece(lag_s[1::2], score[1::2]), piece(lag_s[::2], score[::2])
    curve = score_curve([odd, even], 0.0, 5000.0, 3000.4)
    near = np.abs(lag_s - 3000.4) <= NEAR_S
    assert np.array_equal(curve.near_lag_s, lag_s[near])
    assert np.array_equal(curve.near, score[near], equal_nan=True)


def test_of_a_lag_that_comes_twice_the_better_score_counts() -> None:
    lag_s = np.arange(0.0, 100.0)
    curve = score_curve([piece(lag_s, lag_s), piece(lag_s, 50.0 - lag_s)], 0.0, 100.0, 20.0)
    assert curve.near == pytest.approx(np.maximum(lag_s, 50.0 - lag_s))


def test_few_lags_leave_no_holes() -> None:
    curve = score_curve([piece(np.arange(10.0), np.arange(10.0))], 0.0, 9.0, 5.0)
    assert np.array_equal(curve.lag_s, np.arange(10.0))
    assert np.array_equal(curve.high, np.arange(10.0))


def test_gaps_stay_gaps() -> None:
    lag_s = np.arange(0.0, 10_000.0)
    score = np.where((lag_s >= 3000) & (lag_s < 4000), np.nan, 1.0)
    curve = score_curve([piece(lag_s, score)], 0.0, 10_000.0, 0.0)
    inside = (curve.lag_s > 3000) & (curve.lag_s < 4000)
    assert np.isnan(curve.high[inside]).all()
    assert np.isfinite(curve.high[~inside]).all()


def test_nothing_is_an_empty_curve() -> None:
    assert no_curve().is_empty
    assert score_curve([], 0.0, 1.0, 0.0).is_empty
    assert score_curve([piece(np.arange(3.0), np.full(3, np.nan))], 0.0, 3.0, 1.0).is_empty


def test_memory_does_not_grow_with_the_search() -> None:
    length = 1 << 16

    def pieces(count: int) -> Iterator[LagScores]:
        for k in range(count):
            lag_s = np.arange(k * length, (k + 1) * length, dtype=np.float64)
            yield piece(lag_s, np.sin(lag_s))

    peaks = []
    for count in (4, 64):
        tracemalloc.start()
        score_curve(pieces(count), 0.0, float(count * length), 1000.0)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0]
