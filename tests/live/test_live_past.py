"""The feed's own past, by a clock that may be set."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from live_feeds import NS, T0_NS, Camera

from rsenf.errors import UsageError
from rsenf.live.judge import Suspects
from rsenf.live.past import OwnPast, RecentValues, in_reference
from rsenf.live.settings import LiveSettings
from rsenf.match.series import Grid


@pytest.mark.parametrize("set_s", [-100, 56 * 31_557_600])
def test_a_clock_that_was_set_leaves_no_past_and_takes_no_memory(set_s: int) -> None:
    """A host without a clock of its own begins in 1970, and is told the time later."""
    past, camera = OwnPast(24.0), Camera()
    estimates = [camera.estimate(second, second) for second in range(200)]
    for second, estimate in enumerate(estimates):
        past.add(estimate, T0_NS + (set_s * NS if second > 60 else 0))
    assert past.repeated(estimates[-50:], T0_NS + set_s * NS) is None


def test_a_ring_keeps_the_latest_in_the_memory_of_its_beginning() -> None:
    ring = RecentValues(5, np.int64)
    assert [values.size for values in ring.held] == [0, 0]
    for k in range(13):
        ring.add(k, k**2)
    t_ns, values = ring.held
    assert sorted(zip(t_ns, values, strict=True)) == [(k, k**2) for k in range(8, 13)]


def test_windows_that_overlap_have_no_phase_to_search_by() -> None:
    camera = Camera()
    estimates = [
        dataclasses.replace(camera.estimate(k, k), end_pts_ns=(k + 20) * NS) for k in range(50)
    ]
    grid = Grid("ce", 50.0, T0_NS, 1.0, np.full(600, 50.0))
    assert in_reference(estimates, T0_NS, grid, 60.0) is None


def test_estimates_of_two_origins_are_not_searched_for_together() -> None:
    suspects, camera = Suspects(LiveSettings(), OwnPast(1.0)), Camera()
    for second in range(100, 150):
        suspects.add(camera.estimate(second, second))
    again = dataclasses.replace(camera.estimate(150, 150), origin_pts_ns=150 * NS)
    suspects.add(again)
    assert suspects._waiting == [again]


def test_hours_without_end_are_refused() -> None:
    with pytest.raises(UsageError, match="keep_hours"):
        LiveSettings(keep_hours=math.inf)
