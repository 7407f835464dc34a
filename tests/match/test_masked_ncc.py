"""The masked correlation by FFT against the plain loop."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsenf.match import ncc
from tests.match.match_clips import whole_table
from tests.oracle import masked_ncc as oracle


@settings(max_examples=60, deadline=None)
@given(
    n=st.integers(3, 40),
    extra=st.integers(-10, 120),
    holes=st.floats(0, 0.7),
    seed=st.integers(0, 2**32 - 1),
    min_pairs=st.integers(1, 12),
)
def test_every_lag_equals_the_loop(n, extra, holes, seed, min_pairs):
    rng = np.random.default_rng(seed)
    x, y = (50 + 0.02 * rng.standard_normal(k) for k in (n, max(n + extra, 1)))
    x_ok, y_ok = (rng.random(v.size) > holes for v in (x, y))
    table = whole_table(
        np.where(x_ok, x, np.nan), x_ok, np.where(y_ok, y, np.nan), y_ok, min_pairs=min_pairs
    )
    expected = oracle.masked_ncc(x, x_ok, y, y_ok, min_pairs)
    assert table.lags[0] == 1 - n
    assert table.lags[-1] == y.size - 1
    for lag, pairs, offset, residual in zip(
        table.lags, table.pairs, table.offset, table.residual_var, strict=True
    ):
        want = expected[int(lag)]
        if want is None:
            assert np.isnan(offset)
            assert np.isnan(residual)
        else:
            assert pairs == want[0]
            assert offset == pytest.approx(want[2], abs=1e-10)
            assert residual == pytest.approx(want[3], abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_correlation_equals_the_loop(seed):
    rng = np.random.default_rng(seed)
    y = 50 + 0.02 * np.cumsum(rng.standard_normal(400)) / 10
    x = y[120:180] + 0.001 * rng.standard_normal(60)
    x_ok, y_ok = rng.random(60) > 0.2, rng.random(400) > 0.2
    table = whole_table(x, x_ok, y, y_ok, min_pairs=10)
    expected = oracle.masked_ncc(x, x_ok, y, y_ok, 10)
    for lag, correlation in zip(table.lags, table.correlation, strict=True):
        want = expected[int(lag)]
        assert np.isnan(correlation) if want is None else correlation == pytest.approx(want[1])
    assert table.lags[np.nanargmax(table.correlation)] == 120


def test_stretches_of_a_long_reference_are_the_same_as_one(monkeypatch):
    rng = np.random.default_rng(5)
    y = 50 + 0.02 * rng.standard_normal(5000)
    x = y[3000:3100]
    x_ok, y_ok = rng.random(100) > 0.1, rng.random(5000) > 0.3
    whole = whole_table(x, x_ok, y, y_ok)
    monkeypatch.setattr(ncc, "MIN_FFT", 1)
    parts = list(ncc.lag_tables(x, x_ok, y, y_ok))
    assert len(parts) > 5
    pieced = whole_table(x, x_ok, y, y_ok)
    np.testing.assert_array_equal(pieced.pairs, whole.pairs)
    np.testing.assert_allclose(pieced.residual_var, whole.residual_var, atol=1e-15)
    np.testing.assert_allclose(pieced.correlation, whole.correlation, atol=1e-9)


def test_small_differences_survive_beside_a_large_level():
    """A residual of 0.1 mHz beside 50 Hz and 20 mHz keeps its digits."""
    rng = np.random.default_rng(8)
    y = 50 + 0.02 * np.cumsum(rng.standard_normal(20000)) / 30
    x = y[7000:7600] + 1e-4 * rng.standard_normal(600) - 3.5e-3
    ok_x, ok_y = np.ones(600, bool), np.ones(20000, bool)
    table = whole_table(x, ok_x, y, ok_y, min_pairs=600)
    at = int(np.nanargmin(table.residual_var))
    exact = ncc.compare_at(x, ok_x, y, ok_y, 7000)
    assert table.lags[at] == 7000
    assert table.residual_var[at] == pytest.approx(exact.residual_var, rel=1e-4)
    assert table.offset[at] == pytest.approx(exact.offset, abs=1e-12)
    assert exact.offset == pytest.approx(-3.5e-3, abs=2e-5)


def test_a_stuck_meter_has_no_correlation_but_a_residual():
    y = np.full(300, 49.987)
    y[:100] += 0.01 * np.sin(np.arange(100))
    x = y[20:60].copy()
    ok_x, ok_y = np.ones(40, bool), np.ones(300, bool)
    table = whole_table(x, ok_x, y, ok_y, min_pairs=40)
    stuck = table.lags >= 110
    compared = stuck & (table.pairs == 40)
    assert np.isnan(table.correlation[compared]).all()
    assert np.isfinite(table.residual_var[compared]).all()
    assert np.isnan(ncc.compare_at(x, ok_x, y, ok_y, 150).correlation)


def test_nothing_valid_gives_nothing():
    x, y = np.full(10, np.nan), np.full(50, 50.0)
    table = whole_table(x, np.zeros(10, bool), y, np.ones(50, bool))
    assert not np.isfinite(table.residual_var).any()
    assert ncc.compare_at(x, np.zeros(10, bool), y, np.ones(50, bool), 5).pairs == 0
    assert ncc.compare_at(x, np.zeros(10, bool), y, np.ones(50, bool), 500).pairs == 0
