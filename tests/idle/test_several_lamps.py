"""Rows under several lamps in different phases: the read-out is as uncertain as they make it."""

from __future__ import annotations

import pytest

from rsenf.flicker.conversions import SEAMS
from rsenf.flicker.mains import NO_GRID
from rsenf.flicker.phase_tracker import HALF
from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import Header, IdleEstimate
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.foreign_camera import film
from tests.discrepancy.foreign_camera.trials import trial


def idle_of(
    kind: str, seed: int, rate: str, nominal_hz: float, grid: str
) -> tuple[IdleEstimate, float]:
    filmed = film(trial(kind, seed, rate=rate, nominal_hz=nominal_hz, grid=grid, duration_s=60.0))
    stage = make_idle(IdleSettings(method="coherent"))
    for block in blocks_from_luminance(filmed.level, filmed.stamp_s, Header()):
        stage.update(block)
    (said,) = [m for m in stage.flush() if isinstance(m, IdleEstimate)][-1:]
    return said, filmed.truth["idle_ratio"]


@pytest.mark.parametrize(
    ("rate", "nominal_hz", "grid", "seed"),
    [("25", 60.0, "continental", 40134), ("24000/1001", 50.0, "rough", 36184)],
)
def test_the_second_harmonic_tells_a_mixture(
    rate: str, nominal_hz: float, grid: str, seed: int
) -> None:
    said, truth = idle_of("several sources", seed, rate, nominal_hz, grid)
    assert said.verdict == "estimated"
    assert abs(said.idle_ratio - truth) < 3.0 * said.idle_ratio_var**0.5
    assert any("several phases" in words for words in said.warnings)


@pytest.mark.parametrize(("rate", "grid", "seed"), [("60", "rough", 40109), ("30", "rough", 40159)])
def test_what_is_left_of_still_light_tells_one(rate: str, grid: str, seed: int) -> None:
    said, truth = idle_of("several sources", seed, rate, 60.0, grid)
    assert said.verdict == "estimated"
    assert abs(said.idle_ratio - truth) < 3.0 * said.idle_ratio_var**0.5


def test_one_lamp_is_as_sure_as_before() -> None:
    said, truth = idle_of("second harmonic", 40005, "60.02", 50.0, "rough")
    assert abs(said.idle_ratio - truth) < 1e-4
    assert said.idle_ratio_var**0.5 < 1e-4


def test_part_of_a_period_fits_any_length() -> None:
    """A fluorescent lamp whose phase turns by 1.3 rad, over rows of 0.4 turns."""
    said, _ = idle_of("interlaced", 40174, "60", 60.0, "continental")
    assert said.verdict == "ambiguous"


def test_what_is_followed_and_doubted_is_not_taken_for_the_other_grids() -> None:
    """Light at 50 Hz; where 60 Hz would stand still, 18 points off once."""
    said, _ = idle_of("half-wave part", 46208, "30000/1001", 50.0, "continental")
    assert said.verdict == "no_signal"
    assert said.reason == HALF


def test_light_that_moves_as_no_grids_has_no_idle_period() -> None:
    """A dimmer alone, which was followed for 15 s of 60."""
    said, _ = idle_of("pwm alone", 52184, "24000/1001", 50.0, "continental")
    assert said.verdict == "no_signal"
    assert said.reason == NO_GRID


def test_a_doubtful_frame_rate_is_an_error_of_the_read_out() -> None:
    """59.94 frames/s brought to 30, of which every other one is shown."""
    filmed = film(trial("converted", 50270, rate="60000/1001", nominal_hz=50.0, grid="continental"))
    stage = make_idle(IdleSettings(method="coherent"))
    for block in blocks_from_luminance(filmed.level, filmed.stamp_s, Header()):
        stage.update(block)
    said = stage.flush()[-1]
    assert SEAMS in said.warnings
    std = said.idle_ratio_var**0.5
    assert min(abs(said.idle_ratio - true) for true in filmed.truth["idle_ratios"]) < 3.0 * std
    assert std < 1e-3
