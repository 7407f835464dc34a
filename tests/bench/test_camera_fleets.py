"""Fleets of cameras: the table can tell good ratios from bad ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rsenf.bench.cameras_table import _measured_errors, _tabulated, _text
from tests.bench.bench_records import lit


def record(seed: int, rate: str, error: float | None, std: float = 0.1) -> dict[str, Any]:
    verdict = "refused" if error is None else "estimated"
    said = {"verdict": verdict, "error_percent": error, "std_percent": std}
    return lit(seed, {"coherent": said}, {}, frame_rate=rate, idle_percent=50.0)


def fleet_records(size: float) -> list[dict[str, Any]]:
    """Clips whose errors are so many times those that are stated."""
    errors = np.random.default_rng(1).normal(0, 0.1 * size, 40)
    return [record(n, ("25", "29.97")[n % 2], float(e)) for n, e in enumerate(errors)]


def test_errors_are_those_of_the_read_out_time() -> None:
    errors, tried = _measured_errors([record(1, "25", 0.2), record(2, "25", None)])
    assert tried == 2
    assert errors == {"25": [(pytest.approx(-0.004), pytest.approx(0.002))]}


def test_honest_errors_make_honest_ratios() -> None:
    told = _tabulated(fleet_records(1.0), 2, 1)
    assert len(told["cases"]) == 2
    for case in told["cases"]:
        assert case["recordings"] == 100
        assert case["excluded"] <= 1
        assert case["rank"]["1"] > 0.75
        assert case["cllr_bits"] < 0.3
        for row in case["rows"]:
            assert row["other"] <= case["comparisons"] * 10 ** -row["log10"]
    assert "2 fleets of 50 cameras" in _text(told)


def test_it_shows_when_stated_errors_are_far_too_small() -> None:
    good, bad = (_tabulated(fleet_records(size), 2, 1)["cases"][0] for size in (1.0, 20.0))
    assert bad["cllr_bits"] > 2 * good["cllr_bits"]
    assert bad["excluded"] > 10
    assert bad["rank"]["1"] < good["rank"]["1"]


def test_without_an_estimate_there_is_no_fleet() -> None:
    told = _tabulated([record(1, "25", None)], 2, 1)
    assert told["cases"] == []
    assert _text(told)
