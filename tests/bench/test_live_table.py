"""Records of the live study to its table and the limits that come of it."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rsenf.bench.live.table import (
    ALARMS,
    CORRELATION,
    NOT_LIVE,
    VERDICT,
    WANTED_PER_HOUR,
    WORTH,
    _fitted_nats,
    _limits_file,
    _tabulated,
    _text,
    live_at,
    span_of,
)
from rsenf.bench.statistics import count_bound
from rsenf.errors import InputError
from rsenf.live.settings import Limits


def record(kind: str = "honest", **changed: Any) -> dict[str, Any]:
    attack_s = None if kind == "honest" else 300.0
    return {
        "key": f"{kind}-1",
        "kind": kind,
        "part": "test",
        "seed": 1,
        "truth": {"grid": "us-3"},
        "attack_s": attack_s,
        "honest_s": attack_s or 3600.0,
        "limit_nats": 42.1,
        "verdicts": [],
        "alarms": [],
        "wrong_s": [],
        "settled_s": (attack_s or 3600.0) - 60.0,
        "live_s": 120.0,
        "before": "live",
        "wrong_at_nats": [[6.0, []], [20.0, []], [40.0, []]],
        "wrong_at_correlation": [[0.5, []], [0.8, []]],
        "versions": {"rsenf": "0"},
    } | changed


FALSE = record(
    wrong_at_nats=[[6.0, [100.0, 500.0]], [20.0, []], [40.0, []]],
    wrong_at_correlation=[[0.5, []], [0.8, [100.0, 120.0, 900.0]]],
)
LOOP = record(
    "loop", truth={"grid": "us-3", "recoded": True}, wrong_s=[330.0],
    alarms=[[320.0, "phase_jump", "a jump"]],
    wrong_at_nats=[[6.0, [310.0]], [20.0, [320.0]], [40.0, [330.0]]],
)  # fmt: skip


def test_false_alarms_come_with_the_hours_and_a_bound() -> None:
    honest = {row["rule"]: row for row in _tabulated([FALSE, LOOP])["honest"]}
    assert honest[VERDICT]["false"] == 0
    assert honest[VERDICT]["hours"] == pytest.approx(3900 / 3600)
    assert honest[VERDICT]["bound_per_hour"] == pytest.approx(2.9957 * 3600 / 3900, rel=1e-3)
    assert honest[CORRELATION]["false"] == 2


def test_each_rule_has_its_own_delay() -> None:
    rows = {row["rule"]: row for row in _tabulated([FALSE, LOOP])["attacks"]}
    assert rows[VERDICT]["delay_median_s"] == 30.0
    assert rows[ALARMS]["delay_median_s"] == 20.0
    assert rows[CORRELATION]["found"] == 0
    assert rows[CORRELATION]["delay_median_s"] is None


def test_what_is_no_longer_live_was_live_before() -> None:
    verdicts = [[0.0, "undecided"], [40.0, "no_signal"], [60.0, "live"], [310.0, "no_signal"]]
    document = _tabulated([LOOP | {"verdicts": verdicts}])
    (row,) = (row for row in document["attacks"] if row["rule"] == NOT_LIVE)
    assert row["delay_median_s"] == 10.0
    assert {r["rule"]: r["false"] for r in document["honest"]}[NOT_LIVE] == 0


def test_a_lower_limit_is_sooner_and_less_sure() -> None:
    trade_off = _tabulated([FALSE, LOOP])["trade_off"]["nats"]
    assert [row["false"] for row in trade_off] == [2, 0, 0]
    assert [row["delay_median_s"] for row in trade_off] == [10.0, 20.0, 30.0]


def test_pictures_that_come_again_to_the_last_bit_are_no_matter_of_a_limit() -> None:
    bits = LOOP | {"truth": {"grid": "us-3", "recoded": False}}
    assert [r["attacks"] for r in _tabulated([LOOP, bits])["trade_off"]["nats"]] == [1, 1, 1]


@pytest.mark.parametrize("on_page", [False, True])
def test_the_table_says_all_that_it_counts(on_page: bool) -> None:
    document = _tabulated([FALSE, LOOP, record(alarms=[[7.0, "loop", "comes round"]])])
    whole = _text(document, on_page=on_page)
    assert "loop: comes round" in whole
    assert "42.1 nats" in whole


def test_a_table_of_nothing_is_no_crash() -> None:
    assert "feeds: 0" in _text(_tabulated([]))


def test_fitted_limit_is_extrapolated_from_the_lowest_that_was_silent() -> None:
    nats, silent, hours = _fitted_nats([FALSE, LOOP])
    assert (silent, hours) == (20.0, pytest.approx(3900 / 3600))
    rate = count_bound(0) / hours * math.exp(-WORTH * (nats - silent))
    assert rate == pytest.approx(WANTED_PER_HOUR)
    made = _limits_file([FALSE, LOOP])
    assert span_of(Limits(**made["nats"])) == pytest.approx(nats, abs=0.02)
    assert "us-3" in made["made"]


def test_more_silent_hours_want_less_of_a_limit() -> None:
    few, many = (_fitted_nats([record()] * n)[0] for n in (1, 100))
    assert many == pytest.approx(few - math.log(100) / WORTH)


def test_no_limit_comes_of_feeds_that_are_false_at_all() -> None:
    with pytest.raises(InputError):
        _limits_file([record(wrong_at_nats=[[6.0, [1.0]], [20.0, [1.0]], [40.0, [1.0]]])])


def test_limits_keep_their_proportions() -> None:
    one, two = live_at(20.0).limits, live_at(40.0).limits
    assert span_of(two) == pytest.approx(40.0)
    assert two.live / one.live == pytest.approx(2.0)
