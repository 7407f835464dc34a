"""Phase steps under light whose parts leak into each other, on a foreign camera."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.track import TrackSettings, make_tracker
from tests.contracts.clips import blocks_of
from tests.discrepancy.foreign_camera import Case, film


@pytest.mark.parametrize(
    ("lamp", "hidden", "seed"),
    [("half_wave", (), 2), ("half_wave", (), 5), ("led", ("harmonics",), 4)],
)
def test_ramps_that_disagree_widen_the_errors(
    lamp: str, hidden: tuple[str, ...], seed: int
) -> None:
    case = Case(
        hidden=hidden,
        seed=seed,
        times=30.0,
        duration_s=40.0,
        rows=240,
        lamp=lamp,
        rate="30000/1001",
        nominal_hz=50.0,
    )
    filmed = film(case)
    tracker = make_tracker(TrackSettings(method="phase"))
    blocks = blocks_of(filmed.level, filmed.stamp_s)
    told = [e for block in blocks for e in tracker.update(block)] + tracker.flush()
    usable = [e for e in told if e.usable]
    assert len(usable) > 0.8 * len(told)
    from_s = np.array(filmed.truth["grid_s"])
    true_hz = np.interp([e.t_s - 0.5 for e in usable], from_s, filmed.truth["grid_hz"])
    z = (np.array([e.enf_hz for e in usable]) - true_hz) / np.sqrt([e.enf_var_hz2 for e in usable])
    assert np.sqrt(np.mean(z**2)) < 1.7
