"""Records of the live study to its table, its picture and the limits that come of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rsenf.bench.live.fit import MARGIN, limits_file
from rsenf.bench.live.picture import draw
from rsenf.bench.live.rules import live_at, span_of
from rsenf.bench.live.table import ALARMS, CORRELATION, VERDICT, tabulated
from rsenf.bench.live.text import page, text
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
        "alarm_s": [],
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
    "loop", wrong_s=[330.0], alarms=[[320.0, "phase_jump", "a jump"]], alarm_s=[320.0, 330.0],
    wrong_at_nats=[[6.0, [310.0]], [20.0, [320.0]], [40.0, [330.0]]],
)  # fmt: skip


def test_false_alarms_come_with_the_hours_and_a_bound() -> None:
    honest = {row["rule"]: row for row in tabulated([FALSE, LOOP])["honest"]}
    assert honest[VERDICT]["false"] == 0
    assert honest[VERDICT]["hours"] == pytest.approx(3900 / 3600)
    assert honest[VERDICT]["bound_per_hour"] == pytest.approx(2.9957 * 3600 / 3900, rel=1e-3)
    assert honest[CORRELATION]["false"] == 2


def test_each_rule_has_its_own_delay() -> None:
    rows = {row["rule"]: row for row in tabulated([FALSE, LOOP])["attacks"]}
    assert rows[VERDICT]["delay_median_s"] == 30.0
    assert rows[ALARMS]["delay_median_s"] == 20.0
    assert rows[CORRELATION]["found"] == 0
    assert rows[CORRELATION]["delay_median_s"] is None


def test_a_lower_limit_is_sooner_and_less_sure() -> None:
    trade_off = tabulated([FALSE, LOOP])["trade_off"]["nats"]
    assert [row["false"] for row in trade_off] == [2, 0, 0]
    assert [row["delay_median_s"] for row in trade_off] == [10.0, 20.0, 30.0]


@pytest.mark.parametrize("written", [text, page])
def test_the_table_says_all_that_it_counts(written: Any) -> None:
    whole = written(tabulated([FALSE, LOOP, record(alarms=[[7.0, "loop", "comes round"]])]))
    assert "loop: comes round" in whole
    assert "42.1 nats" in whole


def test_a_table_of_nothing_is_no_crash() -> None:
    assert "feeds: 0" in text(tabulated([]))


def test_the_trade_off_is_drawn(tmp_path: Path) -> None:
    draw(tmp_path / "a.png", tabulated([FALSE, LOOP]))
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


def test_fitted_limit_has_a_margin_over_the_lowest_that_was_silent() -> None:
    made = limits_file([FALSE, LOOP])
    assert span_of(Limits(**made["nats"])) == pytest.approx(MARGIN * 20.0, abs=0.02)
    assert "us-3" in made["made"]


def test_no_limit_comes_of_feeds_that_are_false_at_all() -> None:
    with pytest.raises(InputError):
        limits_file([record(wrong_at_nats=[[6.0, [1.0]], [20.0, [1.0]], [40.0, [1.0]]])])


def test_limits_keep_their_proportions() -> None:
    one, two = live_at(20.0).limits, live_at(40.0).limits
    assert span_of(two) == pytest.approx(40.0)
    assert two.live / one.live == pytest.approx(2.0)
