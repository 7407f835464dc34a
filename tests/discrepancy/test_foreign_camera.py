"""Effects in rows that another camera has made are named too."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rsenf.discrepancy.measured import measured_of
from rsenf.discrepancy.result import discovery_json
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.verdict import discover
from rsenf.messages import Header
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy import foreign_camera
from tests.discrepancy.foreign_camera.simple import film


def _discover(seed: int, **hidden: Any) -> dict[str, Any]:
    level, stamp_s = film(seed, **hidden)
    return _of_rows(level.astype(np.float32), stamp_s)


def _of_rows(
    level: np.ndarray, stamp_s: np.ndarray, *, beyond_catalogue: bool = False
) -> dict[str, Any]:
    measured = measured_of(list(blocks_from_luminance(level, stamp_s, Header())))
    return discovery_json(discover(PLAIN, measured, beyond_catalogue=beyond_catalogue), "")


def test_it_lacks_nothing() -> None:
    assert _discover(1)["verdict"] == "no_discrepancy"


@pytest.mark.parametrize(
    ("hidden", "name", "checked"),
    [
        ({"other_lamp": 0.12}, "second_lamp", {}),
        ({"tone": (987.0, 0.002)}, "pwm_tone", {"tone_hz": 987.0, "depth_ratio": 0.002}),
        ({"jitter_s": 8e-5}, "capture_jitter", {}),
        ({"lost": (250, 611)}, "frame_drop", {"at_frames": [250, 611]}),
    ],
)
def test_what_it_hides_is_named(hidden: dict[str, Any], name: str, checked: dict[str, Any]) -> None:
    told = _discover(2, **hidden)
    assert told["verdict"] == "explained"
    (step,) = told["effects"]
    assert name in (step["class"] or [step["name"]])
    checked = checked if step["name"] else {}
    for parameter, value in checked.items():
        assert step["parameters"][parameter] == pytest.approx(value, rel=0.05)
    assert told["gap"]["shrinkage"] > 0.9


def test_rows_that_swing_slowly_are_followed_to_the_ends() -> None:
    case = foreign_camera.Case(
        hidden=("row_banding",), seed=9724, times=3.0, duration_s=16.0, rows=64
    )
    filmed = foreign_camera.film(case)
    told = _of_rows(filmed.level, filmed.stamp_s, beyond_catalogue=True)
    assert told["verdict"] == "explained"
    assert {effect["name"] for effect in told["effects"]} == {"row_banding", "harmonics"}
