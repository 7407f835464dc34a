"""A real camera: from the paper's model to the error of its clock, found beside a reference."""

from __future__ import annotations

from pathlib import Path

import pytest

from rsenf.discrepancy.beside import beside_json
from tests.discrepancy.clock_cases import gopro

pytestmark = pytest.mark.measured


# By the photodiode where nothing moved; what the moving clip says is nearer to half of that.
@pytest.mark.parametrize(
    ("name", "low_ppm", "high_ppm", "shrinks"),
    [
        ("exp_HAL_50cm_wall", 70.0, 73.0, 0.99),
        ("exp_INC_100cm_wall", 70.0, 73.0, 0.99),
        ("experiment_a", 30.0, 42.0, 0.98),
    ],
)
def test_the_clock_of_a_real_camera_is_found(
    measured_data: Path, name: str, low_ppm: float, high_ppm: float, shrinks: float
) -> None:
    told = beside_json(gopro(measured_data, name, "photodiode"), "")
    (step,) = told["effects"]
    assert step["name"] == "clock_skew"
    assert low_ppm < step["parameters"]["clock_ppm"] < high_ppm
    assert told["gap"]["after"] < told["gap"]["before"] / 50.0
    assert told["gap"]["shrinkage"] > shrinks
    # What is left is either chance's, or said to be unexplained, and where it is.
    if told["gap"]["after"] > told["gap"]["limit"]:
        assert told["verdict"] == "unexplained"
        assert told["unexplained"]["places"]
    assert told["reference"]["read_as"] == "an average over 20 s"
