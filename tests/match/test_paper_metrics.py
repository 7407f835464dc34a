"""The paper's four metrics on tables small enough to be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.match import MatchSettings, metric
from rsenf.match.paper_search import Hypotheses, Label, Tally

# (line in Hz, harmonic, m, idle ratio): lag, peak correlation
F0 = (100.0, 1, 0, 0.0)
LOW = (40.0, 1, -2, 0.0)
TWICE = (200.0, 2, 0, 0.0)
F0_AT_30 = (100.0, 1, 0, 0.3)
LOW_AT_30 = (40.0, 1, -2, 0.3)
LOW_AT_45 = (40.0, 1, -2, 0.45)


def tally_of(table, **settings) -> Tally:
    labels = tuple(Label(50.0, k, m, hz, idle) for (hz, k, m, idle), *_ in table)
    lag_s, correlation = (np.array([row[i] for row in table], float) for i in (1, 2))
    count = len(table)
    return Tally(
        hypotheses=Hypotheses(labels, 10.0, 1.0, 20.0, np.zeros((count, 41))),
        settings=MatchSettings(**settings),
        lag_s=lag_s,
        correlation=correlation,
        offset_hz=np.full(count, -1e-3),
        seconds=np.full(count, 41.0),
        lags=1000,
    )


def said(found):
    return found.decision, found.lag_s, found.correlation, found.idle_ratio


TABLE = [
    (F0, 500.0, 0.95),
    (LOW, 700.0, 0.96),
    (TWICE, 123.0, 0.30),
    (F0_AT_30, 900.0, 0.99),
    (LOW_AT_30, 701.0, 0.955),
    (LOW_AT_45, 699.0, 0.80),
]


def test_metric_1_is_the_line_at_f0_without_idle():
    assert said(metric(tally_of(TABLE), 1)) == ("match", 500.0, 0.95, 0.0)


def test_metric_2_is_the_best_line_without_idle():
    assert said(metric(tally_of(TABLE), 2)) == ("match", 700.0, 0.96, 0.0)


def test_metric_3_is_the_best_of_all():
    assert said(metric(tally_of(TABLE), 3)) == ("match", 900.0, 0.99, 0.3)


def test_metric_4_is_what_most_agree_on():
    """The group about 700 s: n = 3 of at most 3, ρ = 0.96 of at most 0.99: d = 1.394.

    That about 900 s: n = 1/3, ρ = 1: d = 1.054. The one about 500 s: 1/3, 0.9596: d = 1.016.
    """
    found = metric(tally_of(TABLE), 4)
    assert said(found) == ("match", 700.0, 0.96, 0.0)
    assert [c.lag_s for c in found.candidates] == [700.0, 900.0, 500.0]


def test_metric_4_weighs_number_against_correlation():
    """Over 3 and 0.99: two at 20 s, n = 0.667, ρ = 0.960; three at 30 s, n = 1, ρ = 0.955."""
    table = [
        (F0, 10.0, 0.99), (LOW, 20.0, 0.95), (TWICE, 20.0, 0.1), (F0_AT_30, 30.0, 0.945),
        (LOW_AT_30, 30.0, 0.945), (LOW_AT_45, 30.5, 0.944),
    ]  # fmt: skip
    assert said(metric(tally_of(table), 4))[:2] == ("match", 30.0)
    # One more for 20 s, and the numbers are even: its correlation decides.
    table.append(((70.0, 1, -1, 0.1), 19.0, 0.2))
    assert said(metric(tally_of(table), 4))[:2] == ("match", 20.0)


def test_a_group_spans_a_second_either_way():
    table = [(F0, 10.0, 0.99), (LOW, 20.0, 0.95), (TWICE, 21.0, 0.1), (F0_AT_30, 22.0, 0.2)]
    # About 21 s there are three, and the best of them is at 20 s.
    assert said(metric(tally_of(table), 4))[:3] == ("match", 20.0, 0.95)
    apart = [(F0, 10.0, 0.99), (LOW, 20.0, 0.95), (TWICE, 22.0, 0.1)]
    assert said(metric(tally_of(apart), 4))[:2] == ("match", 10.0)


def test_agreement_below_the_threshold_decides_nothing():
    """Four lags agree, but none of them correlates enough: only the lone one counts."""
    table = [
        (F0, 10.0, 0.941), (LOW, 20.0, 0.94), (TWICE, 20.0, 0.93), (F0_AT_30, 20.0, 0.93),
        (LOW_AT_30, 20.0, 0.9),
    ]  # fmt: skip
    assert said(metric(tally_of(table), 4))[:2] == ("match", 10.0)
    found = metric(tally_of(table[1:]), 4)
    assert said(found)[:3] == ("no_decision", 20.0, 0.94)
    assert "no peak correlation above 0.94" in found.reason


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_the_threshold_is_a_setting(number):
    table = [(F0, 10.0, 0.95), (LOW, 10.0, 0.91), (F0_AT_30, 10.0, 0.9)]
    assert metric(tally_of(table), number).decision == "match"
    found = metric(tally_of(table, threshold_correlation=0.96), number)
    assert (found.decision, found.lag_s) == ("no_decision", 10.0)


@pytest.mark.parametrize(("number", "hypotheses"), [(1, 1), (2, 3), (3, 6), (4, 6)])
def test_a_finding_says_how_much_was_searched_and_no_likelihood_ratio(number, hypotheses):
    found = metric(tally_of(TABLE), number)
    assert found.search_size == 1000 * hypotheses
    assert np.isnan([found.log10_lr, found.log10_lr_absent, found.lag_std_s]).all()
    assert found.verbal == ""
    assert "no likelihood ratio" in " ".join(found.warnings)
    assert found.seconds_used == 41.0
    assert found.clock_ppm == pytest.approx(20.0)


def test_at_twice_f0_the_clock_is_not_known():
    found = metric(tally_of([(TWICE, 5.0, 0.99)]), 3)
    assert found.decision == "match"
    assert np.isnan(found.clock_ppm)


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_nothing_compared_is_no_decision(number):
    found = metric(tally_of([(F0, np.nan, np.nan), (LOW_AT_30, np.nan, np.nan)]), number)
    assert (found.decision, found.candidates) == ("no_decision", ())
    assert "at no time" in found.reason
