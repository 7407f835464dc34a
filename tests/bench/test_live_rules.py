"""The literature's rule against a slow twin, and how alarms are counted."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rsenf.bench.live.table import (
    _correlation,
    _sliding_correlation,
    false_and_delay,
    onsets,
)
from rsenf.bench.statistics import count_bound
from rsenf.messages import EnfEstimate, Header, ReferenceBlock, RowBlock

S = 10**9
LATE_NS = S // 5


def rows() -> RowBlock:
    return RowBlock(
        header=Header(arrival_time_ns=1000 * S + LATE_NS),
        frames=1,
        rows=1,
        strips=1,
        frame_number=np.zeros(1, np.int64),
        frame_pts_ns=np.zeros(1, np.int64),
        level=np.zeros((1, 1, 1), np.float32),
        kept_px=np.ones((1, 1), np.uint32),
    )


def estimate(second: int, enf_hz: float, *, usable: bool = True) -> EnfEstimate:
    return EnfEstimate(
        header=Header(arrival_time_ns=(1000 + second + 15) * S),
        start_pts_ns=second * S,
        end_pts_ns=(second + 1) * S,
        enf_hz=enf_hz,
        usable=usable,
        amplitude_pts_ns=np.zeros(0, np.int64),
        **{f"amplitude_{n}": np.zeros(0) for n in ("re", "im", "var_re", "var_im", "cov")},
    )


def reference(freq_hz: np.ndarray, arrival_ns: int) -> ReferenceBlock:
    return ReferenceBlock(
        header=Header(arrival_time_ns=arrival_ns),
        t0_ns=1000 * S + LATE_NS,
        step_ns=S,
        samples=freq_hz.size,
        freq_hz=freq_hz,
        readings=np.ones(freq_hz.size, np.uint32),
    )


def test_correlation_is_pearsons_over_each_window() -> None:
    rng = np.random.default_rng(1)
    grid = 50 + 0.02 * np.cumsum(rng.standard_normal(80))
    camera = grid + 0.01 * rng.standard_normal(80)
    messages = [rows(), reference(grid, 0), *(estimate(s, hz) for s, hz in enumerate(camera))]
    found = list(_sliding_correlation(messages, window=30))
    slow = [np.corrcoef(camera[n - 30 : n], grid[n - 30 : n])[0, 1] for n in range(30, 81)]
    np.testing.assert_allclose([value for _, value in found], slow, atol=1e-9)
    assert found[0][0] == (1000 + 29 + 15) * S


def test_an_estimate_waits_for_the_reference() -> None:
    grid = 50 + 0.001 * np.arange(40.0)
    messages = [
        rows(),
        *(estimate(s, 50 + 0.001 * s) for s in range(30)),
        reference(grid, 2000 * S),
    ]
    ((at_ns, value),) = _sliding_correlation(messages, window=30)
    assert at_ns == 2000 * S
    assert value == pytest.approx(1.0)


def test_seconds_without_an_estimate_are_passed_over() -> None:
    grid = 50 + 0.001 * np.arange(40.0)
    some = [estimate(s, 50 + 0.001 * s, usable=s % 2 == 0) for s in range(20)]
    found = list(_sliding_correlation([rows(), reference(grid, 0), *some], window=10))
    assert len(found) == 1


def test_what_stands_still_has_no_correlation() -> None:
    assert math.isnan(_correlation(np.stack([np.full(30, 50.0), np.arange(30.0)], axis=1)))


def test_an_alarm_begins_where_there_was_none() -> None:
    assert onsets([(0, False), (1, True), (2, True), (3, False), (4, True)]) == [1, 4]


def test_alarms_soon_after_another_are_the_same() -> None:
    assert false_and_delay([10.0, 50.0, 100.0, 200.0], 300.0) == (2, None)


def test_alarms_before_the_attack_are_false_and_the_first_after_it_counts() -> None:
    assert false_and_delay([5.0, 130.0, 150.0], 120.0) == (1, 10.0)
    assert false_and_delay([5.0], 120.0) == (1, None)
    assert false_and_delay([5.0, 300.0], None) == (2, None)


@pytest.mark.parametrize("events", [0, 1, 5])
def test_bound_of_a_count_leaves_so_few_a_chance_of_one_in_twenty(events: int) -> None:
    mean = count_bound(events)
    chance = sum(math.exp(-mean) * mean**k / math.factorial(k) for k in range(events + 1))
    assert chance == pytest.approx(0.05)
