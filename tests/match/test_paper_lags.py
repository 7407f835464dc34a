"""Many series against one: the same as the masked correlation of each."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.match.paper_search import best_lags
from tests.match.match_clips import whole_table


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("length", [300, 40_000])
def test_each_equals_the_masked_correlation(length, holes):
    rng = np.random.default_rng(2)
    y = 50 + np.cumsum(rng.normal(0, 1e-3, length))
    y_ok = np.ones(length, bool)
    x = np.stack([y[20 + k : 80 + k] + rng.normal(0, 2e-3, 60) for k in range(0, 60, 10)])
    x_ok = np.ones(60, bool)
    if holes:
        y_ok[rng.random(length) < 0.1] = False
        y_ok[100:160] = False
        x_ok[[3, 17, 18, 40]] = False
        x[:, ~x_ok], y[~y_ok] = np.nan, np.nan
    found = best_lags(x, x_ok, y, y_ok, min_pairs=30)
    for i, one in enumerate(x):
        table = whole_table(one, x_ok, y, y_ok, min_pairs=30)
        top = int(np.nanargmax(table.correlation))
        assert found.lag[i] == table.lags[top]
        assert found.correlation[i] == pytest.approx(table.correlation[top], abs=1e-9)
        assert found.offset[i] == pytest.approx(table.offset[top], abs=1e-12)
        assert found.pairs[i] == table.pairs[top]
        assert found.compared == int((table.pairs >= 30).sum())


def test_what_has_no_correlation_has_no_lag():
    rng = np.random.default_rng(1)
    y = rng.normal(50, 0.01, 500)
    x = np.stack([np.full(50, 50.0), y[100:150]])
    every = np.ones(50, bool)
    found = best_lags(x, every, y, np.ones(500, bool), min_pairs=20)
    assert np.isnan(found.correlation[0])
    assert found.lag[1] == 100
    assert found.correlation[1] == pytest.approx(1.0)
    nothing = best_lags(x, every, y, np.zeros(500, bool), min_pairs=20)
    assert np.isnan(nothing.correlation).all()
    assert nothing.compared == 0
