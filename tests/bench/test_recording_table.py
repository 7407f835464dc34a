"""Tables of trials count every one as what it was."""

from __future__ import annotations

from typing import Any

import pytest

from rsenf.bench.recording_time.table import _tabulated, _text
from rsenf.bench.statistics import rate_bound


def trial(method: str, outcome: str, trial: str = "present", **more: Any) -> dict[str, Any]:
    return {
        "piece": 0, "trial": trial, "method": method, "outcome": outcome,
        "coding": "lossless", "length_s": 60.0, "lag_error_s": 0.1, "lag_std_s": 0.2,
        "clock_error_ppm": 3.0, "clock_std_ppm": 1.0,
    } | more  # fmt: skip


def record(
    trials: list[dict[str, Any]], coding: str = "lossless", length_s: float = 60.0, **more: Any
) -> dict[str, Any]:
    cut = {"coding": coding, "length_s": length_s}
    return {
        "key": "k", "kind": "still", "seed": 1, "reference_s": 86400.0, "noise_mhz": 0.3,
        "grid": "g", "versions": {"source": "a"}, "trials": [trial | cut for trial in trials],
    } | more  # fmt: skip


SAID = [
    *[trial("phase", "true")] * 3, trial("phase", "false"), trial("phase", "none"),
    {"piece": 0, "trial": "present", "method": "phase", "broke": "ValueError: x"},
    trial("phase", "false", "same_day"), *[trial("phase", "none", "other_day")] * 2,
]  # fmt: skip


def test_every_trial_is_counted_once() -> None:
    (row,) = _tabulated([record(SAID)])["rows"]
    assert (row["present"], row["true"], row["false"], row["none"], row["broke"]) == (6, 3, 1, 1, 1)
    assert row["true_percent"] == pytest.approx(50.0)
    assert (row["absent"], row["absent_false"]) == (3, 1)
    assert row["absent_bound_percent"] == pytest.approx(100 * rate_bound(1, 3))


def test_cells_are_kind_coding_length_and_method() -> None:
    records = [
        record(SAID), record(SAID, kind="moving"), record(SAID, coding="50k"),
        record(SAID, length_s=120.0), record([*SAID, trial("ncc", "none")]),
    ]  # fmt: skip
    rows = _tabulated(records)["rows"]
    assert len(rows) == 5
    assert max(row["present"] for row in rows) == 12


def test_false_decisions_are_pooled_by_length_and_over_all() -> None:
    records = [record(SAID), record(SAID, kind="moving", coding="50k", length_s=120.0)]
    rows = {row["length_s"]: row for row in _tabulated(records)["absent"]}
    assert {length: (r["absent"], r["absent_false"]) for length, r in rows.items()} == {
        60.0: (3, 1), 120.0: (3, 1), "all": (6, 2), "≥120": (3, 1),
    }  # fmt: skip
    assert rows["all"]["absent_bound_percent"] == pytest.approx(100 * rate_bound(2, 6))


def metrics(*true: int) -> list[dict[str, Any]]:
    return [
        trial(f"metric{n}", "true" if k < count else "none")
        for n, count in enumerate(true, 1)
        for k in range(5)
    ]


@pytest.mark.parametrize(
    ("true", "holds"), [((1, 2, 2, 5), True), ((1, 2, 3, 2), False), ((2, 1, 3, 3), False)]
)
def test_the_metrics_order_is_checked(true: tuple[int, ...], holds: bool) -> None:
    row, pooled = _tabulated([record(metrics(*true))])["order"]
    assert pooled == row | {"length_s": "all"}
    assert row["true"] == list(true)
    assert row["trials"] == 5
    assert row["holds"] is holds
    assert f"in {2 * int(holds)} of 2 cells" in _text(_tabulated([record(metrics(*true))]))


def test_compressed_films_are_one_cell_of_the_order() -> None:
    records = [record(metrics(1, 1, 1, 1), coding=c) for c in ("150k", "50k", "lossless")]
    rows = _tabulated(records)["order"]
    found = {(row["coded"], row["length_s"], row["trials"]) for row in rows}
    assert found == {
        ("compressed", 60.0, 10), ("compressed", "all", 10),
        ("lossless", 60.0, 5), ("lossless", "all", 5),
    }  # fmt: skip


def test_errors_of_true_decisions_are_held_against_what_was_said_of_them() -> None:
    said = [trial("phase", "true", clock_error_ppm=e) for e in (1.0, -1.0, 5.0)]
    (row,) = _tabulated([record([*said, trial("phase", "none", clock_error_ppm=99.0)])])["rows"]
    assert row["true"] == 3
    assert row["clock_rms_ppm"] == pytest.approx(3.0)
    assert row["clock_within"] == pytest.approx(2 / 3)
    assert row["lag_within"] == pytest.approx(1.0)


@pytest.mark.parametrize("on_page", [False, True])
def test_tables_say_what_they_were_made_of(on_page: bool) -> None:
    records = [record(SAID), record(metrics(1, 2, 3, 4), kind="moving", seed=2, versions={})]
    said = _text(_tabulated(records), on_page=on_page)
    assert "films: 2; seeds 1 to 2; grid: g; reference: 24 h; its noise: 0.3 mHz" in said
    assert "made by 2 versions" in said
    assert "46/0/54" in said  # the paper's Metric 1
    assert "50/17/17 1 broke" in said


def test_a_table_of_nothing_can_be_written() -> None:
    assert "films: 0" in _text(_tabulated([]))
