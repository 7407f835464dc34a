"""Tables count every clip as what it was."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rsenf.bench.clip_tables import _tabulated, _text
from rsenf.bench.statistics import rate_bound
from tests.bench.bench_records import enf, idle, lit

BROKE = {"broke": "ValueError: x"}
SAID = [
    idle("estimated", 0.2, 0.1), idle("estimated", -0.1, 0.1), idle("estimated", 0.7, 0.1),
    idle("ambiguous", 9.0, 0.1), idle("refused"), idle("refused"), idle("no_signal"), BROKE,
]  # fmt: skip


def idle_row(**more: Any) -> dict[str, Any]:
    records = [lit(n, {"coherent": said}, {}, **more) for n, said in enumerate(SAID)]
    (row,) = _tabulated("idle", records)["rows"]
    return row


def test_idle_counts_verdicts_and_judges_estimates_alone() -> None:
    row = idle_row()
    counted = {v: row[v] for v in ("estimated", "ambiguous", "refused", "no_signal", "broke")}
    assert counted == {
        "estimated": 3, "ambiguous": 1, "refused": 2, "no_signal": 1, "broke": 1,
    }  # fmt: skip
    assert sum(counted.values()) == row["clips"] == len(SAID)
    assert row["median_percent"] == pytest.approx(0.2)
    assert row["worst_percent"] == pytest.approx(0.7)
    assert row["spread"] == pytest.approx(math.sqrt((4 + 1 + 49) / 3))
    assert row["cpu_ms_per_s"] == pytest.approx(10.0)


def test_alias_at_zero_is_a_cell_by_how_far_the_flicker_turns() -> None:
    at_25 = {"frame_rate": "25", "frames": 1500}
    assert idle_row()["turned"] is None
    assert idle_row(**at_25, alias_turn_rad=12.0)["turned"] is True
    assert idle_row(**at_25, alias_turn_rad=0.9)["turned"] is False
    assert idle_row(nominal_hz=60.0, alias_turn_rad=45.0)["turned"] is True  # 0.12 Hz


def test_sizes_make_cells_unless_pooled() -> None:
    records = [lit(n, {"coherent": idle("refused")}, {}, size=s) for n, s in enumerate("ab")]
    assert [row["clips"] for row in _tabulated("idle", records)["rows"]] == [1, 1]
    assert [row["clips"] for row in _tabulated("idle", records, pooled=True)["rows"]] == [2]


def test_enf_errors_are_rms_of_a_clip_and_a_clip_without_values_is_none() -> None:
    records = [
        lit(0, {}, {"stft": enf([3.0, 4.0]), "projection": enf([0.3, 0.4])}),
        lit(1, {}, {"stft": enf([]), "projection": enf([1.0, -1.0])}, flicker_level=3.0),
        lit(2, {}, {"stft": enf([0.1] * 30), "projection": BROKE}),
    ]
    rows = {row["method"]: row for row in _tabulated("enf", records)["rows"]}
    stft, projection = rows["stft"], rows["projection"]
    assert (stft["with_values"], projection["with_values"]) == (2, 2)
    assert stft["worst_mhz"] == pytest.approx(math.sqrt(12.5))
    assert stft["usable_ratio"] == pytest.approx(32 / 180)
    assert projection["median_mhz"] == pytest.approx((math.sqrt(0.125) + 1.0) / 2)
    assert projection["spread"] == pytest.approx(math.sqrt((0.36 + 0.64 + 4 + 4) / 4))


def nothing(seed: int, scene: str, **found: Any) -> dict[str, Any]:
    return lit(seed, {"coherent": found["idle"]}, {"stft": found["enf"]}, scene=scene)


def test_claims_are_values_that_were_given() -> None:
    records = [
        nothing(0, "black", idle=idle("refused"), enf=enf([])),
        nothing(1, "black", idle=idle("ambiguous"), enf=enf([])),  # without a value: no claim
        nothing(2, "daylight", idle=idle("ambiguous", 3.0, 0.1), enf=enf([5.0])),
        nothing(3, "anti_flicker", idle=idle("estimated", 0.1, 0.1), enf=enf([9.0])),
        nothing(4, "anti_flicker", idle=BROKE, enf=BROKE),
    ]
    rows = {(row["scene"], row["kind"]): row for row in _tabulated("claims", records)["rows"]}
    assert (rows["black", "idle"]["claims"], rows["black", "enf"]["claims"]) == (0, 0)
    assert (rows["daylight", "idle"]["claims"], rows["daylight", "idle"]["right"]) == (1, 0)
    assert (rows["anti_flicker", "idle"]["claims"], rows["anti_flicker", "idle"]["right"]) == (1, 1)
    assert (rows["anti_flicker", "enf"]["claims"], rows["anti_flicker", "enf"]["right"]) == (1, 0)
    everything = rows["all", "idle"]
    assert (everything["clips"], everything["claims"], everything["right"]) == (5, 2, 1)
    assert everything["broke"] == 1
    assert everything["bound_ratio"] == rate_bound(2, 5)
    assert everything["false_bound_ratio"] == rate_bound(1, 5)


@pytest.mark.parametrize("table", ["idle", "enf", "claims"])
def test_every_table_can_be_written(table: str) -> None:
    records = [
        lit(0, {"coherent": SAID[0], "line_ratio": BROKE}, {"stft": enf([1.0])}),
        lit(1, {"coherent": SAID[4]}, {"stft": enf([])}, frame_rate="25", frames=1500),
    ]
    document = _tabulated(table, records)
    assert "seeds 0 to 1" in _text(document)
    lines = [line for line in _text(document, on_page=True).splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1
    assert len(lines) > 2


def test_records_of_several_versions_are_said_to_be() -> None:
    records = [lit(n, {}, {}, versions={"source": s}) for n, s in enumerate("ab")]
    assert "made by 2 versions" in _text(_tabulated("idle", records))


def test_tables_of_nothing_can_be_written() -> None:
    for table in ("idle", "enf", "claims"):
        assert "clips: 0" in _text(_tabulated(table, []))
