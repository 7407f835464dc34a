"""A real camera: from the paper's model to the error of its clock, found beside a reference."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rsenf.discrepancy.clock_offset import beside_json
from rsenf.discrepancy.clock_offset.clip import FEWEST_BLOCKS
from tests.discrepancy.clock_cases import gopro

pytestmark = pytest.mark.measured


def test_the_clock_of_a_real_camera_is_found(measured_data: Path) -> None:
    told = beside_json(gopro(measured_data, "exp_INC_100cm_wall", "photodiode"), "")
    (step,) = told["effects"]
    assert step["name"] == "clock_skew"
    assert 70.0 < step["parameters"]["clock_ppm"] < 73.0
    assert told["gap"]["after"] < told["gap"]["before"] / 50.0
    assert told["gap"]["shrinkage"] > 0.99
    # What is left is either chance's, or said to be unexplained, and where it is.
    if told["gap"]["after"] > told["gap"]["limit"]:
        assert told["verdict"] == "unexplained"
        assert told["unexplained"]["places"]
    assert told["reference"]["read_as"] == "an average over 22 s"


def test_the_window_of_the_photodiode_is_found_and_nothing_is_left(measured_data: Path) -> None:
    found = gopro(measured_data, "exp_HAL_50cm_wall", "photodiode")
    assert found.beside.averaged_s == pytest.approx(22.2, abs=0.7)
    assert found.verdict == "explained"


def test_a_short_clip_beside_a_wide_average_is_answered(measured_data: Path) -> None:
    """The wider the window, the fewer blocks there are to judge by."""
    short = {"seconds": 260.0, "averaged_s": 40.0}
    found = gopro(measured_data, "exp_HAL_50cm_wall", "photodiode", **short)
    assert found.beside.blocks >= FEWEST_BLOCKS
    assert json.dumps(beside_json(found, ""), allow_nan=False)
