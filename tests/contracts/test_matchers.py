"""What every matcher must do, whoever made it; and that a faulty one is caught."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import pytest

from rsenf.match import METHODS, Finding, Grid, Match, MatchSettings, Track, tracker_for
from rsenf.match.phase import match_phase
from rsenf.messages import EnfEstimate, MatchResult
from rsenf.model import CaptureModel, GridPath, Scene, Shutter, simulate_rows
from rsenf.track import METHODS as ENF_METHODS
from rsenf.track import TrackSettings, make_tracker
from tests.contracts.clips import blocks_of
from tests.match.match_clips import grid_from, wandering_grid

REFERENCE_S, START_S, CLIP_S = 1800, 734.4, 180.0
NEAR_S = 1.0  # a lag as near as this is right


@functools.cache
def estimates(enf_method: str) -> list[EnfEstimate]:
    """Return what a tracker says of a clip of the reference's grid, from ``START_S`` on."""
    model = CaptureModel(
        shutter=Shutter(rows=48, columns=64, idle_ratio=0.2), scene=Scene(texture_ratio=0.02)
    )
    path = GridPath(wandering_grid(REFERENCE_S, 7), 1.0, START_S, 50.0)
    rows = simulate_rows(model, path, CLIP_S, 1)
    stage = make_tracker(TrackSettings(method=enf_method, nominal_hz=50.0))
    blocks = blocks_of(rows.level, rows.frame_time_s)
    return [e for block in blocks for e in stage.update(block)] + stage.flush()


def searched(method: str, grid: Grid) -> MatchResult:
    stage = Match(method=method, grids=(grid,))
    for estimate in estimates(tracker_for(method) or TrackSettings.method):
        stage.update(estimate)
    (result,) = stage.flush()
    return result  # type: ignore[no-any-return]


def check_found(method: str) -> None:
    result = searched(method, grid_from(wandering_grid(REFERENCE_S, 7)))
    assert result.method == method
    assert result.decision == "match", result.reason
    assert abs(result.lag_s - START_S) <= NEAR_S


def check_absent(method: str, seed: int) -> None:
    result = searched(method, grid_from(wandering_grid(REFERENCE_S, seed)))
    assert result.decision in ("no_match", "no_decision")
    assert result.reason


@pytest.mark.parametrize("method", METHODS)
def test_the_enf_method_that_it_needs_is_there(method: str) -> None:
    needed = tracker_for(method)
    assert not needed or needed in ENF_METHODS
    # Hypotheses are what it compares.
    assert not needed or any(e.rank for e in estimates(needed))


@pytest.mark.parametrize("method", METHODS)
def test_it_finds_the_time(method: str) -> None:
    check_found(method)


@pytest.mark.parametrize("seed", [8, 9])
@pytest.mark.parametrize("method", METHODS)
def test_it_finds_no_time_in_another_grids_course(method: str, seed: int) -> None:
    check_absent(method, seed)


def late(
    track: Track, grids: Sequence[Grid], settings: MatchSettings, claimed_utc_ns: int = 0
) -> Finding:
    """Five seconds off."""
    found = match_phase(track, grids, settings, claimed_utc_ns)
    return dataclasses.replace(found, lag_s=found.lag_s + 5.0)


def never(
    track: Track, grids: Sequence[Grid], settings: MatchSettings, claimed_utc_ns: int = 0
) -> Finding:
    """Decides nothing."""
    return Finding(decision="no_decision", reason="who knows?", grid=grids[0])


def always(
    track: Track, grids: Sequence[Grid], settings: MatchSettings, claimed_utc_ns: int = 0
) -> Finding:
    """Takes the best lag for the right one."""
    found = match_phase(track, grids, settings, claimed_utc_ns)
    return dataclasses.replace(found, decision="match")


@pytest.mark.parametrize(
    ("fault", "check", "of"),
    [(late, check_found, ()), (never, check_found, ()), (always, check_absent, (8,))],
    ids=lambda x: getattr(x, "__name__", None),
)
def test_a_fault_is_caught(
    fault: Any, check: Any, of: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(METHODS, "_items", dict(METHODS._items))
    METHODS.register("faulty", fault)
    with pytest.raises(AssertionError):
        check("faulty", *of)
