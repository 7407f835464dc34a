from __future__ import annotations

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.model import GridPath


def slow_frequency_hz(path: GridPath, t_s: float) -> float:
    """The definition: linear between the centres of the samples, constant outside."""
    centres_s = (np.arange(path.freq_hz.size) + 0.5) * path.step_s
    return float(np.interp(t_s + path.start_s, centres_s, path.freq_hz))


@pytest.mark.parametrize(("step_s", "start_s"), [(1.0, 0.0), (1.0, 3.7), (2.0, 5.25), (0.5, 0.1)])
def test_phase_is_the_integral_of_the_frequency(step_s: float, start_s: float) -> None:
    rng = np.random.default_rng(5)
    path = GridPath(50 + 0.5 * rng.standard_normal(12), step_s, start_s)
    fine_s = np.linspace(0, path.length_s, 20_001)
    middle_s = (fine_s[1:] + fine_s[:-1]) / 2
    slow = np.concatenate(
        ([0], np.cumsum(np.diff(fine_s) * [slow_frequency_hz(path, t) for t in middle_s]))
    )
    assert path.cycles(fine_s) == pytest.approx(slow, abs=1e-6)
    assert path.frequency_hz(middle_s[::100]) == pytest.approx(
        [slow_frequency_hz(path, t) for t in middle_s[::100]], abs=1e-12
    )


def test_times_of_any_shape_and_phase_zero_at_the_start() -> None:
    path = GridPath([50.0, 50.2, 49.9], start_s=1.3)
    times = np.array([[0.0, 0.4], [0.8, 1.1]])
    assert path.cycles(times).shape == (2, 2)
    assert path.cycles(np.zeros(1))[0] == 0.0
    assert path.cycles(times)[1, 1] == path.cycles(np.array([1.1]))[0]


def test_mean_over_a_second_of_a_straight_line() -> None:
    path = GridPath(50 + 0.01 * np.arange(10), start_s=2.0)
    means = path.mean_hz(np.array([0.0, 1.0]), np.array([1.0, 2.0]))
    assert means == pytest.approx([50.02, 50.03], abs=1e-12)


def test_gaps_are_bridged_by_a_line_and_named() -> None:
    path = GridPath([50.0, np.nan, np.nan, 50.3, 50.3, np.nan], start_s=0.5)
    assert path.freq_hz == pytest.approx([50.0, 50.1, 50.2, 50.3, 50.3, 50.3])
    assert path.gaps_within(2.0) == [(0.5, 2.5)]
    assert path.gaps_within(10.0) == [(0.5, 2.5), (4.5, 5.5)]
    assert path.gaps_within(0.4) == []


def test_a_gap_before_the_start_doesn_t_count() -> None:
    assert GridPath([50.0, np.nan, 50.0, 50.0], start_s=2.0).gaps_within(1.0) == []


def test_the_nominal_frequency_is_the_nearer_one() -> None:
    assert GridPath([60.01, 59.98]).nominal_hz == 60.0
    assert GridPath([49.97]).nominal_hz == 50.0


@pytest.mark.parametrize(
    ("freq_hz", "start_s", "says"),
    [
        ([], 0.0, "no frequency"),
        ([np.nan, np.nan], 0.0, "no frequency"),
        ([100.0, 99.9], 0.0, "not near 60 Hz"),
        ([50.0, 50.0], 2.0, "not on the grid path"),
        ([50.0, 50.0], -0.1, "not on the grid path"),
    ],
)
def test_what_can_t_be_a_path(freq_hz: list[float], start_s: float, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        GridPath(freq_hz, start_s=start_s)
