"""The feed's own past, by a clock that may be set."""

from __future__ import annotations

import numpy as np
import pytest
from live_feeds import NS, T0_NS, Camera

from rsenf.live.past import OwnPast, RecentValues


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
