"""What a best fit is worth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rsenf.match.score import Peak
from rsenf.match.search import Search, _log10_lr_of_chance, expected_chance_fits, verbal


def search_of(scores, tail, seconds=281.0):
    peaks = [Peak(i * 100.0, s, seconds, 0.9, 0.0, 1e-6, 0.0) for i, s in enumerate(scores)]
    return Search(peaks, tail, 1, 1, 1, None, [])


def test_chance_fits_are_counted_rightly_when_there_is_only_chance():
    """With exponential scores, a best one as rare as 1 in n comes up no more often than that."""
    rng = np.random.default_rng(3)
    tail, stretches, trials = 40, 1600, 3000
    chances = []
    for _ in range(trials):
        scores = np.sort(rng.exponential(3.0, stretches))[::-1]
        chances.append(expected_chance_fits(search_of(scores[: tail + 2], tail), 20.0))
    for limit in (0.3, 0.1, 0.03, 0.01):
        allowed = limit * trials + 4 * math.sqrt(limit * trials)
        assert sum(c <= limit for c in chances) <= allowed
    # And it isn't blind either: about as often as it says.
    assert sum(c <= 0.3 for c in chances) > 0.1 * trials


def test_chance_falls_with_the_lead_and_needs_others():
    one, two = (expected_chance_fits(search_of([s, 9, 8, 7, 6, 5], 4), 20.0) for s in (20, 40))
    assert two < one
    assert math.isinf(expected_chance_fits(search_of([10.0], 4), 20.0))
    assert expected_chance_fits(search_of([10.0, 3.0], 4), 20.0) > 0


@pytest.mark.parametrize(
    ("chance", "log10_lr"), [(math.inf, 0.0), (1.0, 0.0), (1e-3, 1.726), (1e-9, 7.249)]
)
def test_a_significance_is_not_taken_for_a_likelihood_ratio(chance, log10_lr):
    assert _log10_lr_of_chance(chance) == pytest.approx(log10_lr, abs=2e-3)
    assert _log10_lr_of_chance(chance) <= max(-math.log10(chance), 0.0) if chance < 1 else True


@pytest.mark.parametrize(
    ("log10_lr", "words"),
    [
        (math.nan, ""),
        (0.0, "no support either way"),
        (0.29, "no support either way"),
        (0.31, "weak support for this time"),
        (1.0, "moderate support for this time"),
        (2.5, "moderately strong support for this time"),
        (60.0, "strong support for this time"),
        (-1.2, "moderate support against this time"),
        (-60.0, "strong support against this time"),
    ],
)
def test_words(log10_lr, words):
    assert verbal(log10_lr) == words
