"""Windows at a 60 Hz grid, where the alias is near 0 Hz, on a foreign camera."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.track import TrackSettings, make_tracker
from rsenf.track.stft import OVERTONE, TOO_NEAR
from tests.contracts.clips import blocks_of
from tests.discrepancy.foreign_camera import Case, film

MOST_Z = 2.0


@pytest.mark.parametrize("method", ["stft", "row_concat"])
@pytest.mark.parametrize(
    ("rate", "seed"),
    [("24000/1001", 1), ("30000/1001", 1), ("60000/1001", 1), ("30000/1001", 3)],
)
def test_an_overtone_near_0_hz_is_not_taken_for_the_flicker(
    method: str, rate: str, seed: int
) -> None:
    case = Case(seed=seed, duration_s=32.0, rows=240, lamp="led", rate=rate, nominal_hz=60.0)
    filmed = film(case)
    tracker = make_tracker(TrackSettings(method=method))
    blocks = blocks_of(filmed.level, filmed.stamp_s)
    told = [e for block in blocks for e in tracker.update(block)] + tracker.flush()
    assert len(told) >= 10
    assert all(e.usable or e.reason for e in told)
    usable = [e for e in told if e.usable]
    if not usable:
        known = {OVERTONE, TOO_NEAR, "no mains flicker stands out"}
        assert known & {e.reason for e in told}
        return
    from_s = np.array(filmed.truth["grid_s"])
    true_hz = np.interp([e.t_s - 0.5 for e in usable], from_s, filmed.truth["grid_hz"])
    z = (np.array([e.enf_hz for e in usable]) - true_hz) / np.sqrt([e.enf_var_hz2 for e in usable])
    assert np.sqrt(np.mean(z**2)) < MOST_Z
