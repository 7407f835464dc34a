"""When a recording was made whose frame rate isn't known, or is wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rsenf
from rsenf.match.clip_phase import clip_phase
from rsenf.match.phase import weigh
from rsenf.match.phase_search import search_phase
from rsenf.match.series import Grid, track_of
from rsenf.match.settings import MatchSettings
from rsenf.messages import Header, RateBasis
from rsenf.model import synthetic_grid
from rsenf.run.inputs import Luminance

START_S = 200.0
GRID_HZ = synthetic_grid(seed=61, duration_s=900).freq_hz


def counted(level: np.ndarray, rate_hz: float, basis: RateBasis) -> Luminance:
    held: dict[str, Any] = {"rows": level, "frame_rate_hz": rate_hz}
    return Luminance(held, Header(source="test/c", rate_basis=basis))


@pytest.fixture(scope="module")
def level() -> np.ndarray:
    """75 s of a camera of 28.8 frames a second."""
    clip = rsenf.simulate(
        reference=GRID_HZ, step_s=1.0, start_s=START_S, duration_s=75, size=(32, 120),
        frame_rate="144/5", seed=62,
    )  # fmt: skip
    return np.asarray(clip.rows)


@pytest.mark.parametrize(
    ("basis", "said"),
    [(RateBasis.ASSUMED, "is not known"), (RateBasis.STAMPED, "seems wrong")],
)
def test_the_time_and_the_rate_are_found_together(
    level: np.ndarray, basis: RateBasis, said: str
) -> None:
    found = rsenf.verify(counted(level, 25.0, basis), GRID_HZ, step_s=1.0)
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(START_S, abs=0.2)
    assert found.clock_ppm is None  # the rate's error and the clock's are one
    assert said in found.warnings[0]
    assert "28.80" in found.warnings[0]


def test_nothing_is_found_nor_excluded_in_another_night(level: np.ndarray) -> None:
    other_hz = synthetic_grid(seed=63, duration_s=900).freq_hz
    found = rsenf.verify(counted(level, 25.0, RateBasis.ASSUMED), other_hz, step_s=1.0)
    assert found.decision == "no_decision"
    assert "none fits surely" in found.warnings[0]
    assert found.start_utc is None


def test_every_rate_counts_in_the_chance_of_a_fit(level: np.ndarray) -> None:
    track = track_of(rsenf.track(counted(level, 28.8, RateBasis.GIVEN)).analysis.estimates)
    clip, grid = clip_phase(track), Grid("g", 50.0, 0, 1.0, GRID_HZ)
    assert clip is not None
    alone, many = (
        weigh(search_phase(replace(track, alternatives=n), clip, [grid], MatchSettings()))
        for n in (1, 1000)
    )
    assert alone.absent - many.absent == pytest.approx(3.0)
