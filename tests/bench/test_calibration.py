"""Calibration: lines that mend ratios, and tables that tell whether they did."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.bench.calibration import QUESTIONS, Pairs, cost_of_ratios, fitted, pairs_of, reliability
from rsenf.bench.calibration.real_clips import LAGS_S, there
from rsenf.bench.calibration.searches import real_searched, searched, true_phase
from rsenf.bench.calibration.table import (
    _calibration_file,
    _damage_text,
    _over_damage,
    _tabulated,
    _text,
)
from rsenf.bench.scenes import FIT, TEST, stretches
from rsenf.match.calibration import CalibrationLine, calibration
from tests.match.phase_clips import stretch_of

IDENTITY = CalibrationLine(1.0, 0.0, 9.0)


def honest(rng, count, scale=1.0):
    """Ratios of two Gaussians a distance apart, times a scale: 1 is honest."""
    held, failed = rng.normal(1.0, 1.0, count), rng.normal(-1.0, 1.0, count)
    return Pairs(*(scale * 2 * side / np.log(10) for side in (held, failed)))


def test_a_line_mends_what_is_too_sure():
    rng = np.random.default_rng(1)
    line = fitted(honest(rng, 20_000, scale=3.0))
    assert line.slope == pytest.approx(1 / 3, rel=0.05)
    assert line.intercept == pytest.approx(0, abs=0.05)
    assert line.limit == pytest.approx(np.log10(20_000 / 3), abs=0.01)


def test_modest_ratios_are_not_blown_up():
    assert fitted(honest(np.random.default_rng(2), 20_000, scale=0.5)).slope == 1.0


def test_reliability_tells_honest_ratios_from_boasting_ones():
    rng = np.random.default_rng(3)
    for scale, fine in ((1.0, True), (4.0, False)):
        pairs = honest(rng, 5000, scale)
        rows = reliability(pairs, IDENTITY)
        inside = [row["low"] <= row["said"] <= row["high"] for row in rows]
        assert all(inside) is fine
        assert sum(row["held"] for row in rows) == sum(row["failed"] for row in rows) == 5000
    assert cost_of_ratios(honest(rng, 5000), IDENTITY) < cost_of_ratios(
        honest(rng, 5000, 4.0), IDENTITY
    )


def test_no_ratio_beyond_what_the_cases_can_vouch_for():
    few = Pairs(np.full(300, 50.0), np.full(300, -50.0))
    assert fitted(few)(50.0) <= 2.0


def test_the_package_has_a_calibration_that_can_decide():
    held = calibration()
    for line in held.lines.values():
        assert 0 < line.slope <= 1
        assert 2.0 < line.limit < 5.0


def test_the_clips_phase_is_the_integral_of_the_grid():
    stretch = stretch_of(400, seed=5)
    t_s = np.arange(60) + 0.5
    phase = true_phase(stretch, 100.5, t_s, 0.0)  # the instants are samples' ends
    away = stretch.freq_hz[101:160] - 50.0
    assert np.diff(phase) == pytest.approx(4 * np.pi * away, abs=1e-9)
    late = true_phase(stretch, 100.5, t_s, 100.0)
    assert np.polyfit(t_s, late - phase, 1)[0] == pytest.approx(-4 * np.pi * 0.005, rel=1e-2)


@pytest.mark.measured
def test_searches_of_measured_grids(measured_data):
    names = {part: {s.name for s in stretches(measured_data, part)} for part in (FIT, TEST)}
    assert not names[FIT] & names[TEST]
    records = [searched(FIT, seed, measured_data) for seed in range(4)]
    again = searched(FIT, 2, measured_data)
    assert records[2] == again
    lines = {question: fitted(pairs_of(records, question)) for question in QUESTIONS}
    assert _calibration_file(lines, records)["lines"].keys() == lines.keys()
    document = _tabulated(lines, records)
    assert document["searches"] == 4
    assert document["decisions"]["searches"] == 4
    assert "4 searches" in _text(document)
    for question in ("other", "absent", "claim"):
        assert pairs_of(records, question).held.size <= 4


def best(ratio, *, right=True, score=-5.0):
    return {"other": 9.0, "absent": ratio, "right": right, "score": score, "lag_std_s": 0.1}


def test_decisions_are_counted_over_the_damage():
    lines, nothing = dict.fromkeys(("other", "absent", "claim"), IDENTITY), best(0.0)
    usable = {"usable": True, "least": -9.0, "absent": nothing, "absent_day": best(-3.0)}
    records = [
        usable | {"damage": 0.1, "present": best(3.0)},
        usable | {"damage": 0.1, "present": best(3.0, right=False)},
        usable | {"damage": 0.5, "present": best(-3.0)},
        usable | {"damage": 0.5, "present": best(-3.0, score=1.0)},
        usable | {"damage": 0.5, "present": best(-3.0), "least": -1.0},
        {"damage": 1.0, "usable": False},
    ]
    told = _over_damage(lines, records)
    total = told["total"]
    assert (total["clips"], total["short"], total["found"], total["wrong"]) == (6, 1, 2, 1)
    assert total["excluded"] == 1
    assert (total["absent"], total["absent_excluded"], total["absent_found"]) == (10, 4, 0)
    assert told["decided_falsely"] == 2
    assert [row["clips"] for row in told["rows"]] == [2, 0, 3, 0, 1]
    assert "of these falsely 2" in _damage_text(told)


def test_no_real_clip_both_fits_and_tests(tmp_path):
    assert not set(LAGS_S[FIT]) & set(LAGS_S[TEST])
    assert not there(tmp_path)
    assert not there(None)


@pytest.mark.measured
def test_a_real_clip_made_worse_comes_again(measured_data):
    first, again = (real_searched(TEST, 1, measured_data) for _ in range(2))
    assert first == again
    assert first["grid"] in LAGS_S[TEST]
