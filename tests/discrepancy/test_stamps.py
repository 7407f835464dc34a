"""Stamps that aren't as regular as the model: explained where they can be, exact to their unit."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from rsenf.discrepancy.measured import measured_of
from rsenf.discrepancy.result import discovery_json
from rsenf.discrepancy.verdict import gap_of_stamps
from rsenf.messages import Header
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.hidden_effects import Hidden, hidden


@pytest.mark.parametrize(
    ("effect", "values", "size"),
    [
        ("timestamp_jitter", {"jitter_s": 3e-4}, "jitter_s"),
        ("variable_frame_rate", {"rate_ratio": 3e-5}, "rate_ratio"),
    ],
)
def test_what_stamps_show_is_named(effect: str, values: dict[str, float], size: str) -> None:
    case = hidden(effect, seed=21, **values)
    told = discovery_json(case.discover(), "")
    assert told["verdict"] == "explained"
    (step,) = told["effects"]
    assert step["name"] == effect
    late_s = case.made.frame_time_s - case.data.time_s
    came = late_s.std() if size == "jitter_s" else np.diff(late_s).std() * 30000 / 1001
    assert step["parameters"][size] == pytest.approx(came, rel=0.01)
    assert told["gap"]["shrinkage"] > 0.99


def test_rounded_stamps_are_regular() -> None:
    """Matroska writes milliseconds: errors of half of one are the file's, not the camera's."""
    case = hidden(seed=22)
    stamps = np.round(case.made.frame_time_s, 3)
    blocks = list(blocks_from_luminance(case.made.level, stamps, Header()))
    told = discovery_json(Hidden(case.made, measured_of(blocks)).discover(), "")
    assert told["verdict"] == "no_discrepancy"


def test_stamps_that_wander_without_the_frames_are_not_explained() -> None:
    case = hidden(seed=23)
    t_s = case.made.frame_time_s
    stamps = t_s + 0.004 * np.sin(2 * np.pi * t_s / 3.0)
    blocks = list(blocks_from_luminance(case.made.level, stamps, Header()))
    told = discovery_json(Hidden(case.made, measured_of(blocks)).discover(), "")
    assert told["verdict"] == "unexplained"
    assert told["effects"] == []
    assert told["unexplained"]["stamps_gap"] > 0.1


def test_the_gap_of_stamps_is_that_of_the_light_by_them() -> None:
    late_s = np.array([0.0, 1e-4, -1e-4, 2e-4])
    wrong = np.exp(2j * np.pi * 100.0 * (late_s - late_s.mean())) - 1.0
    assert gap_of_stamps(late_s, 50.0) == pytest.approx(np.mean(np.abs(wrong) ** 2))


@pytest.mark.parametrize("rate", [Fraction(30), Fraction(30000, 1001)])
def test_a_rate_beside_a_usual_one_is_kept(rate: Fraction) -> None:
    """A tenth of a frame in a thousand: after a while counted frames would be a whole one off."""
    slow = np.arange(2000) / (float(rate) * (1.0 - 3e-4))
    level = hidden(seed=24, rate=rate).made.level
    level = np.concatenate([level, level, level])[:2000, :32]
    data = measured_of(list(blocks_from_luminance(level, slow, Header())), 50.0)
    assert np.array_equal(data.slot, np.arange(2000))
    assert data.frame_rate != rate
