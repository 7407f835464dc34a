"""Places near a better one are that one."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.match.phase_search import APART_S, Place, distinct


@pytest.mark.parametrize("seed", range(5))
def test_the_best_of_each_neighbourhood_stays(seed):
    rng = np.random.default_rng(seed)
    places = [
        Place(int(rng.integers(2)), float(lag), 0.1, float(score))
        for lag, score in zip(
            np.round(rng.uniform(-50, 400, 200), 1), rng.standard_normal(200), strict=True
        )
    ]
    plainly: list[Place] = []
    for place in sorted(places, key=lambda p: -p.score):
        if all(p.grid != place.grid or abs(p.lag_s - place.lag_s) >= APART_S for p in plainly):
            plainly.append(place)
    assert distinct(places) == plainly
    assert 50 < len(plainly) < 180


def test_a_neighbourhood_apart_is_another_place():
    places = [Place(0, APART_S * k, 0.1, -k) for k in range(4)]
    assert distinct(places) == places
