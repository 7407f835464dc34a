"""A clock that is off is found beside a reference, and nothing where none is."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.discrepancy.clock_offset import ClockOffsetDiscovery, beside_json, beside_model, joined
from rsenf.errors import InputError
from rsenf.model import CaptureModel
from tests.discrepancy.clock_cases import START_S, Filmed, filmed


@pytest.fixture(scope="module")
def fast() -> Filmed:
    return filmed(60.0, seed=31)


@pytest.fixture(scope="module")
def found(fast: Filmed) -> ClockOffsetDiscovery:
    return fast.discover(fast.grid_hz)


def test_a_fast_clock_is_named_and_the_gap_shrinks(found: ClockOffsetDiscovery) -> None:
    told = beside_json(found, "model.yaml")
    assert told["verdict"] == "explained"
    (step,) = told["effects"]
    assert step["name"] == "clock_skew"
    away = step["parameters"]["clock_ppm"] - 60.0
    assert abs(away) < 4.0 * step["stderr"]["clock_ppm"]
    assert step["stderr"]["clock_ppm"] < 3.0
    assert told["gap"]["before"] > 20.0 * told["gap"]["limit"]
    assert told["gap"]["after"] < told["gap"]["limit"]
    assert told["gap"]["shrinkage"] > 0.9
    assert told["reference"]["lag_s"] == pytest.approx(START_S, abs=0.2)
    assert told["reference"]["reference_noise_hz"] == pytest.approx(3e-4, rel=0.5)


def test_the_model_given_back_lacks_nothing(fast: Filmed, found: ClockOffsetDiscovery) -> None:
    extended = CaptureModel.from_dict(beside_model(found, "a test").to_dict())
    assert [effect.name for effect in extended.effects] == ["clock_skew"]
    assert extended.provenance["stderr"]["clock_skew.clock_ppm"] < 3.0
    again = fast.discover(fast.grid_hz, extended)
    assert again.verdict == "no_discrepancy"
    assert again.skew is None


def test_a_true_clock_stays_so() -> None:
    case = filmed(0.0, seed=32)
    told = beside_json(case.discover(case.grid_hz), "")
    assert (told["verdict"], told["effects"], told["unexplained"]) == ("no_discrepancy", [], None)
    assert told["gap"]["before"] == told["gap"]["after"] < told["gap"]["limit"]


def test_what_moves_otherwise_is_not_explained_by_the_clock(fast: Filmed) -> None:
    """A reference that sways by itself: the clock is found, the swaying is left, and placed."""
    t_s = np.arange(fast.grid_hz.size)
    told = beside_json(fast.discover(fast.grid_hz + 2e-3 * np.sin(2 * np.pi * t_s / 14.0)), "")
    assert told["verdict"] == "unexplained"
    assert told["gap"]["after"] > told["gap"]["limit"]
    bands = [p for p in told["unexplained"]["places"] if p["axis"] == "wander_hz"]
    assert max(bands, key=lambda p: p["share"])["low"] == 0.05  # 1/14 Hz lies in 0.05 to 0.1
    assert told["unexplained"]["would_tell"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda hz: filmed_elsewhere(hz.size), "no match"),
        (lambda hz: np.full_like(hz, 50.0), "doesn't move"),
        (lambda hz: np.full_like(hz, np.nan), "doesn't move"),
        (lambda hz: hz[:40], "no match|covers only"),
    ],
)
def test_a_reference_that_is_none_is_refused(fast: Filmed, change, says: str) -> None:
    with pytest.raises(InputError, match=says):
        fast.discover(change(fast.grid_hz))


def filmed_elsewhere(size: int) -> np.ndarray:
    """A grid of another day."""
    from rsenf.model import synthetic_grid

    return synthetic_grid(77, size + 10.0).freq_hz[:size]


def test_rows_and_reference_are_told_together(found: ClockOffsetDiscovery) -> None:
    rows = {"verdict": "no_discrepancy", "effects": [], "unexplained": None, "gap": {"after": 1}}
    beside = beside_json(found, "")
    both = joined(rows, beside)
    assert (both["verdict"], both["effects"]) == ("explained", beside["effects"])
    assert both["gap"] == {"after": 1}
    assert both["reference"]["gap"] == beside["gap"]
    left = {"places": [1]}
    both = joined(rows | {"verdict": "unexplained", "unexplained": left}, beside)
    assert (both["verdict"], both["unexplained"]) == ("unexplained", left)
    assert both["reference"]["verdict"] == "explained"
