"""The phase that a reference foretells, against the integral of its frequency."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.match import forecast as module
from rsenf.match.forecast import forecast, samples
from rsenf.match.series import Grid
from tests.match.match_clips import wandering_grid
from tests.oracle.integrated import turned_rad


class Lazy:
    """A reference that is only ever read in slices, as one on disk is; it keeps what was asked."""

    def __init__(self, freq_hz):
        self._freq_hz, self.size, self.asked = freq_hz, freq_hz.size, []

    def __getitem__(self, part):
        assert isinstance(part, slice)
        self.asked.append(part)
        return self._freq_hz[part]


def gappy(step_s, seed=2):
    freq_hz = wandering_grid(120, seed)
    freq_hz[[17, 40, 41, 42, 80]] = np.nan
    return Grid("g", 50.0, 0, step_s, freq_hz)


@pytest.mark.parametrize("step_s", [0.1, 1.0, 2.0])
def test_every_way_between_instants_is_the_integral(step_s):
    grid = gappy(step_s)
    rng = np.random.default_rng(3)
    t_s = step_s * (0.5 + np.cumsum(rng.choice([0.25, 1.0, 1.7, 3.0], 25)))
    # Within, over both ends, beyond one, on the samples' borders, and over gaps.
    lag_s = step_s * np.array([3.3, -20.0, 95.2, 140.0, 2.5, 12.0, -90.0, 30.01])
    phase, known = forecast(grid, lag_s, t_s)
    assert phase.shape == known.shape == (25, 8)
    assert not known[0].any()
    for c, lag in enumerate(lag_s):
        for i in range(1, t_s.size):
            ends = lag + t_s[i - 1], lag + t_s[i]
            expected = turned_rad(grid.freq_hz, grid.nominal_hz, step_s, *ends)
            assert known[i, c] == (expected is not None)
            if expected is not None:
                assert phase[i, c] - phase[i - 1, c] == pytest.approx(expected, abs=1e-9)
    assert known.any(axis=0).sum() == 6


def test_lags_in_parts_are_the_same_as_all_at_once(monkeypatch):
    grid, t_s = gappy(1.0), np.arange(0.5, 30.0)
    lag_s = np.random.default_rng(4).uniform(-20, 110, 50)
    phase, known = forecast(grid, lag_s, t_s)
    monkeypatch.setattr(module, "AT_ONCE", 7)
    in_parts = forecast(grid, lag_s, t_s)
    np.testing.assert_array_equal(in_parts[1], known)
    np.testing.assert_allclose(np.diff(in_parts[0], axis=0), np.diff(phase, axis=0), atol=1e-9)


def test_a_reference_on_disk_is_read_in_order_and_no_more_of_it_than_a_clip_covers():
    freq_hz = wandering_grid(500, 5)
    lazy = Lazy(freq_hz)
    lag_s, t_s = np.array([300.2, 10.7, 150.0]), np.arange(0.5, 40.0)
    got = forecast(Grid("g", 50.0, 0, 1.0, lazy), lag_s, t_s)
    for a, b in zip(got, forecast(Grid("g", 50.0, 0, 1.0, freq_hz), lag_s, t_s), strict=True):
        np.testing.assert_array_equal(a, b)
    assert [part.start for part in lazy.asked] == sorted(part.start for part in lazy.asked)
    assert max(part.stop - part.start for part in lazy.asked) < 50


def test_a_lag_far_away_reads_nothing():
    lazy = Lazy(wandering_grid(100, 6))
    _, known = forecast(Grid("g", 50.0, 0, 1.0, lazy), np.array([1e6, -1e6]), np.arange(0.5, 9.0))
    assert not known.any()
    assert not lazy.asked


def test_samples_beyond_the_ends_are_gaps():
    grid = Grid("g", 50.0, 0, 1.0, np.array([50.0, 50.1, 50.2]))
    np.testing.assert_array_equal(samples(grid, -2, 2), [np.nan, np.nan, 50.0, 50.1])
    np.testing.assert_array_equal(samples(grid, 2, 5), [50.2, np.nan, np.nan])
