"""One search for all metrics says what each says by itself."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.bench.recording_time import PlannedFilm
from rsenf.bench.recording_time.trials import (
    PAPER_METRICS,
    ClipEnf,
    ClipSearch,
    Said,
    _lit_day,
    _setting_of,
    _stretch,
)
from rsenf.match.stage import Match
from rsenf.messages import EnfEstimate, Header, RowBlock
from rsenf.model import GridPath, simulate_rows
from rsenf.reference import reference_blocks
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker

START_S = 700.0
REFERENCE = _stretch(_lit_day(None), 0, 1800)
SAME = ("decision", "reason", "lag_s", "correlation", "clock_ppm", "seconds_used", "idle_ratio")


@pytest.fixture(scope="module")
def blocks() -> list[RowBlock]:
    setting = _setting_of(PlannedFilm("still", 0, "led", 6, "240p"))
    grid = GridPath(_lit_day(None).freq_hz, 1.0, START_S, 50.0)
    rows = simulate_rows(setting.model, grid, 55.0, 1, strips=1)
    return list(blocks_from_luminance(rows.level[:, ::6], rows.frame_time_s, Header()))


@pytest.fixture(scope="module")
def search(blocks: list[RowBlock]) -> ClipSearch:
    return ClipSearch(ClipEnf(blocks), REFERENCE)


@pytest.fixture(scope="module")
def estimates(blocks: list[RowBlock]) -> list[EnfEstimate]:
    tracker = make_tracker(TrackSettings(method="paper", nominal_hz=50.0))
    return [e for block in blocks for e in tracker.update(block)] + tracker.flush()


def same(a: Said, b: Said) -> bool:
    pairs = [(getattr(a, name), getattr(b, name)) for name in SAME]
    return all(x == y or (isinstance(x, float) and np.isnan([x, y]).all()) for x, y in pairs)


@pytest.mark.parametrize("method", PAPER_METRICS)
def test_a_metric_of_the_shared_search_is_that_of_the_stage(
    search: ClipSearch, estimates: list[EnfEstimate], method: str
) -> None:
    stage = Match(method=method)
    for estimate in estimates:
        stage.update(estimate)
    for block in reference_blocks(REFERENCE, source="reference"):
        stage.update(block)
    (alone,) = stage.flush()
    (said,) = search.by(method)
    assert same(said, alone)
    assert said.decision == "match"
    assert abs(said.lag_s - START_S) <= 1.0


def test_a_clip_without_a_window_of_enf_decides_nothing(blocks: list[RowBlock]) -> None:
    short = ClipEnf(blocks[:40])
    gone = dataclasses.replace(REFERENCE, freq_hz=np.full(1800, np.nan))
    for reference in (REFERENCE, gone):
        for method in (*PAPER_METRICS, "ncc", "phase"):
            (said,) = ClipSearch(short, reference).by(method)
            assert said.decision == "no_decision", method
