"""The camera's clock error, from simulated rows through tracker and matcher."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.match import MatchSettings
from rsenf.match.series import Grid
from rsenf.match.stage import Match
from rsenf.messages import Header
from rsenf.model import CaptureModel, Shutter, simulate_rows, synthetic_grid
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker

PATH = synthetic_grid(41, 7200.0).freq_hz
SECONDS = 120.0


# Fast is positive; a twentieth of all such errors are beyond twice the stated one.
@pytest.mark.parametrize("clock_ppm", [-70.0, -20.0, -5.0, 5.0, 20.0, 70.0])
def test_a_clock_error_is_found_within_twice_its_stated_error(clock_ppm: float) -> None:
    model = CaptureModel(shutter=Shutter(rows=64, columns=640)).with_effect(
        "clock_skew", clock_ppm=clock_ppm
    )
    start_s = 3000.0 + 10.0 * clock_ppm
    grid = synthetic_grid(41, 7200.0, start_s=start_s)
    made = simulate_rows(model, grid, SECONDS, seed=42)
    tracker = make_tracker(TrackSettings(nominal_hz=50.0))
    stage = Match(grids=[Grid("grid", 50.0, 0, 1.0, np.array(PATH))], settings=MatchSettings())
    blocks = blocks_from_luminance(made.level, made.frame_time_s, Header())
    for estimate in [e for block in blocks for e in tracker.update(block)] + tracker.flush():
        stage.update(estimate)
    (found,) = stage.flush()
    assert found.decision == "match"
    assert found.lag_s == pytest.approx(start_s, abs=0.2)
    assert found.clock_std_ppm < 3.0
    assert abs(found.clock_ppm - clock_ppm) < 2.0 * found.clock_std_ppm
