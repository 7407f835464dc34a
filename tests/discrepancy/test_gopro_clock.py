"""A real camera: from the paper's model to the error of its clock, found beside a reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rsenf.discrepancy import Film, beside_of, discover_grid, grid_json
from rsenf.match.series import Grid
from rsenf.model import CaptureModel, Light
from tests.discrepancy.clock_cases import track

pytestmark = pytest.mark.measured

PLAIN = CaptureModel(name="plain", light=Light(lamp="tone"))


def read(times_s: np.ndarray, level: np.ndarray) -> list:
    return track(times_s, level, axis="frame", method="frame_mean")


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
    with np.load(measured_data / "gopro_luminance" / f"{name}.npz") as held:
        level, rate_hz = held["luminance"], float(held["frame_rate_hz"])
        # Light flickers at twice the mains' frequency.
        grid = Grid("photodiode", 50.0, 0, 1.0, held["photodiode_enf_combined_hz"] / 2)
    estimates = read(np.arange(level.size) / rate_hz, level[:, None, None])
    film = Film(read, level.size / rate_hz, frame_means=True)
    told = grid_json(discover_grid(PLAIN, beside_of(film, PLAIN, estimates, grid)), "")
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
