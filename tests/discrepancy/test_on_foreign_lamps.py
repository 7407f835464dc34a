"""Effects under lamps of many harmonics, filmed by a camera that shares nothing with the model."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rsenf.discrepancy.lines import along_rows, averaged, enough, fields_of
from rsenf.discrepancy.measured import measured_of
from rsenf.discrepancy.result import discovery_json
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.verdict import discover
from rsenf.messages import Header
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.foreign_camera import UNKNOWN, Case, Filmed, film

SECONDS, ROWS, RATE = 30.0, 240, "30000/1001"


def filmed(
    *hidden: str, seed: int, lamp: str = "led", rows: int = ROWS, seconds: float = SECONDS
) -> Filmed:
    case = Case(
        hidden=hidden, seed=seed, lamp=lamp, duration_s=seconds, rows=rows, rate=RATE,
        nominal_hz=50.0,
    )  # fmt: skip
    return film(case)


def discovered(made: Filmed) -> dict[str, Any]:
    blocks = blocks_from_luminance(made.level, made.stamp_s, Header())
    return discovery_json(discover(PLAIN, measured_of(list(blocks))), "")


def by_name(told: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {name: e for e in told["effects"] for name in (e["class"] or [e["name"]])}


@pytest.mark.parametrize("lamp", ["led", "cfl", "magnetic", "half_wave"])
def test_a_lamp_has_as_many_harmonics_as_the_rows_carry(lamp: str) -> None:
    made = filmed(seed=61, lamp=lamp)
    told = discovered(made)
    assert told["verdict"] == "explained"
    (step,) = told["effects"]
    assert step["name"] == "harmonics"
    found, errors = step["parameters"], step["stderr"]
    ratios = [found["second_ratio"], found["third_ratio"], *found["higher_ratios"]]
    stds = [errors["second_ratio"], errors["third_ratio"], *errors.get("higher_ratios", [])]
    for n, (ratio, std) in enumerate(zip(ratios, stds, strict=True)):
        assert ratio == pytest.approx(made.truth["harmonics"][n + 1], abs=5.0 * std + 1e-4)
    assert bool(found["half_ratios"]) == (lamp == "half_wave")
    assert told["gap"]["shrinkage"] > 0.99


@pytest.mark.parametrize(
    ("name", "size", "true_size"),
    [
        ("auto_exposure", "gain_ratio", "gain_rms_ratio"),
        ("pwm_tone", "tone_hz", "tone_hz"),
        ("second_lamp", "weight", "weight"),
        ("row_banding", "", ""),
        ("readout_drift", "", ""),
    ],
)
def test_an_effect_is_named_beside_them(name: str, size: str, true_size: str) -> None:
    made = filmed(name, seed=66 if name == "pwm_tone" else 62)  # one below 3 kHz
    told = discovered(made)
    found = by_name(told)
    assert name in found
    assert set(found) <= {name, "harmonics", "interharmonic"}  # a slow swing is a gain's class
    assert told["gap"]["shrinkage"] > 0.99
    if size:
        true = made.hidden[name][true_size]
        assert found[name]["parameters"][size] == pytest.approx(true, rel=0.1)
    if "course" in found[name]:
        assert found[name]["course"]["form"]


@pytest.mark.parametrize("name", ["knee", "s_curve", "rolling_bar", "column_drift"])
def test_what_no_catalogue_has_stays_unexplained(name: str) -> None:
    told = discovered(filmed(name, seed=63))
    assert told["verdict"] == "unexplained"
    assert set(by_name(told)) <= {"harmonics", *UNKNOWN[name].like}


def test_rows_are_averaged_and_the_model_has_all_of_them() -> None:
    made = filmed("pwm_tone", seed=64, rows=720)
    data = measured_of(list(blocks_from_luminance(made.level, made.stamp_s, Header())))
    assert (data.lines, data.group, data.rows) == (240, 3, 720)
    told = discovery_json(discover(PLAIN, data), "")
    true = made.hidden["pwm_tone"]
    found = by_name(told)["pwm_tone"]["parameters"]
    assert found["tone_hz"] == pytest.approx(true["tone_hz"], abs=0.01)
    # What averaging three rows takes of a tone is known, and isn't missing in its depth.
    mean = np.mean(true["strip_ratio"]) * true["depth_ratio"]
    assert found["depth_ratio"] == pytest.approx(mean, rel=0.05)


def test_a_fast_tone_takes_more_lines_and_is_told_at_its_own_frequency() -> None:
    made = filmed("pwm_tone", seed=99, rows=720)
    assert enough(made.level) == 240
    assert enough(filmed(seed=99, rows=720).level) == 120
    found = by_name(discovered(made))["pwm_tone"]["parameters"]
    found_hz = found.get("tone_hz") or found["flicker_hz"]
    assert found_hz == pytest.approx(made.hidden["pwm_tone"]["tone_hz"], abs=0.01)


def test_rows_of_two_fields_are_averaged_within_each() -> None:
    assert fields_of(filmed("interlace", seed=65, rows=720).level) == 2
    assert fields_of(filmed("row_banding", seed=65, rows=720).level) == 1
    assert fields_of(filmed("pwm_tone", seed=65, rows=720).level) == 1
    assert fields_of(filmed(seed=65, rows=720).level) == 1
    level = np.arange(16, dtype=np.float32)[None, :, None]
    lines = averaged(level, 3, 2)[0, :, 0]
    np.testing.assert_array_equal(lines, [2, 3, 8, 9])
    rows = along_rows(lines, 3, 16, fields=2, axis=0)
    np.testing.assert_array_equal(rows, [2, 3] * 3 + [8, 9] * 5)
    told = discovered(filmed("interlace", seed=66, rows=720))
    assert set(by_name(told)) == {"harmonics", "interlace"}
    assert told["verdict"] == "explained"
    assert math.isfinite(discovered(filmed(seed=65))["gap"]["after"])


@pytest.mark.parametrize("name", ["interharmonic", "auto_exposure", "readout_drift"])
def test_a_quarter_of_a_minute_is_enough(name: str) -> None:
    told = discovered(filmed(name, seed=67, seconds=15.0))
    assert name in by_name(told)
    assert set(by_name(told)) <= {"harmonics", name, "interharmonic", "auto_exposure"}


def test_a_dimmer_that_switches_the_flicker_too_is_named_with_what_does_the_same() -> None:
    made = filmed("pwm_tone", seed=50053, lamp="magnetic")
    told = discovered(made)
    (step,) = [e for e in told["effects"] if "pwm_tone" in (e["class"] or [e["name"]])]
    true_hz = made.hidden["pwm_tone"]["tone_hz"]
    found_hz = step["parameters"].get("tone_hz") or step["parameters"]["flicker_hz"]
    assert found_hz == pytest.approx(true_hz, abs=1e-3)
