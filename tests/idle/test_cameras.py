"""Known cameras: how recordings combine, what a ratio may say, and what it can't."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rsenf.idle.compare import (
    ASTRAY_RATIO,
    MOST_LOG10_LR,
    SAME_MODEL_RATIO,
    USUAL_FREEDOM,
    USUAL_SCATTER_RATIO,
    Known,
    Mode,
    ReadOutTime,
    known_modes,
    log10_lr,
    log10_odds,
    log10_ratio,
    verdict_of,
)

MODE = Mode(frame_rate_hz=30.0, lines=1080, across_px=1920)


def reading(time_s: float, std_s: float = 1e-5, mode: Mode = MODE) -> ReadOutTime:
    return ReadOutTime(
        recording="", mode=mode, direction="forward", read_out_time_s=time_s,
        read_out_time_std_s=std_s,
    )  # fmt: skip


def camera(*time_s: float, std_s: float = 1e-5) -> Known:
    return Known("a", MODE, tuple(reading(t, std_s) for t in time_s))


def test_what_is_not_known_of_a_mode_excludes_nothing() -> None:
    for other in (
        replace(MODE, across_px=0), replace(MODE, crop="stabilised"),
        replace(MODE, frame_rate_hz=30000 / 1001),
    ):  # fmt: skip
        assert MODE.may_be(other)
        assert other.may_be(MODE)
    for other in (
        replace(MODE, across_px=1440), replace(MODE, lines=720), replace(MODE, frame_rate_hz=25.0),
    ):  # fmt: skip
        assert not MODE.may_be(other)
    stable, full = replace(MODE, crop="stabilised"), replace(MODE, crop="full")
    assert not stable.may_be(full)


def test_recordings_are_sorted_by_mode() -> None:
    slow, crop = replace(MODE, frame_rate_hz=25.0), replace(MODE, crop="stabilised")
    near, unknown = replace(MODE, frame_rate_hz=29.98), replace(MODE, across_px=0)
    modes = (MODE, slow, near, crop, slow, unknown)
    found = known_modes("a", [reading(0.02, mode=m) for m in modes])
    assert [(k.mode, len(k.readings)) for k in found] == [
        (MODE, 2), (slow, 2), (crop, 1), (unknown, 1),
    ]  # fmt: skip


def test_scatter_is_as_usual_until_recordings_tell_otherwise() -> None:
    usual_s = USUAL_SCATTER_RATIO * 0.02
    assert camera(0.02).scatter_s == pytest.approx(usual_s)
    assert camera(*[0.02] * 4).scatter_s < usual_s
    apart = camera(0.0199, 0.0201, std_s=1e-7)
    own_var = 2 * (0.0001) ** 2  # of two: by their difference, halved
    wanted = math.sqrt((USUAL_FREEDOM * usual_s**2 + own_var) / (USUAL_FREEDOM + 1))
    assert apart.scatter_s == pytest.approx(wanted, rel=1e-3)


def test_scatter_is_found_where_there_are_many_recordings() -> None:
    rng = np.random.default_rng(3)
    time_s = 0.02 + rng.normal(0, 2e-4, 400)
    found = camera(*time_s, std_s=1e-5)
    assert found.scatter_s == pytest.approx(2e-4, rel=0.1)
    mean_s, std_s = found.read_out
    assert std_s == pytest.approx(2e-4 / 20, rel=0.1)
    assert abs(mean_s - 0.02) < 4 * std_s


def test_a_sharper_recording_counts_more() -> None:
    known = Known("a", MODE, (reading(0.02, 1e-3), reading(0.021, 1e-6)))
    assert known.read_out[0] == pytest.approx(0.021, abs=2e-6)


def test_scatter_makes_a_difference_bearable() -> None:
    new = reading(0.0203)
    assert log10_lr(camera(0.02, 0.02, 0.02), new) < -1.9
    assert log10_lr(camera(0.0198, 0.0202, 0.0201), new) > 0.5


def test_no_ratio_says_more_than_models_and_gross_errors_let_it() -> None:
    known = camera(0.01)
    assert 1.5 < log10_lr(known, reading(0.01)) < -math.log10(SAME_MODEL_RATIO)
    against = log10_lr(known, reading(0.02))
    assert against == pytest.approx(math.log10(ASTRAY_RATIO / (1 - SAME_MODEL_RATIO)), abs=0.01)
    assert verdict_of(against) == "different"


def test_no_ratio_says_more_than_the_model_of_errors_can() -> None:
    sharp = Known("a", MODE, tuple(reading(0.01, 1e-9) for _ in range(4000)))
    assert log10_lr(sharp, reading(0.01, 1e-9), 0.0) <= MOST_LOG10_LR


def test_the_ratio_is_that_of_two_recordings_where_no_model_is_shared() -> None:
    known, new = camera(0.01), reading(0.01005, 3e-5)
    times = np.array([known.read_out[0], 0.01005])
    stds = np.array([known.read_out[1], math.hypot(3e-5, known.scatter_s)])
    plain = 10 ** log10_ratio(times, stds, 1 / 30.0)
    assert log10_lr(known, new, 0.0) == pytest.approx(
        math.log10(ASTRAY_RATIO + (1 - ASTRAY_RATIO) * plain)
    )


def test_odds_count_the_search() -> None:
    assert log10_odds([1.5]) == pytest.approx(1.5)
    assert log10_odds([2.0, -2.3]) == pytest.approx(math.log10(100 / (2 + 10**-2.3)))
    assert log10_odds([1.9, 1.9]) < 0.0  # two of one model
    assert log10_odds([2.0] + [-2.0] * 49) == pytest.approx(math.log10(100 / 50.49))
