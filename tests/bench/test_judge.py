"""Judging: each method says what it says when it runs alone; what breaks is counted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from rsenf.bench import measure as judge
from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import Header, RowBlock
from rsenf.model import CaptureModel, GridPath, Shutter, simulate_rows, synthetic_grid
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track.stft import StftTracker
from tests.discrepancy.foreign_camera import film
from tests.discrepancy.foreign_camera.trials import trial

GRID = synthetic_grid(21, 40.0)
TRUE_RATIO = 0.3


@pytest.fixture(scope="module")
def blocks() -> list[RowBlock]:
    model = CaptureModel(shutter=Shutter(rows=120, columns=320, idle_ratio=TRUE_RATIO))
    rows = simulate_rows(model, GRID, 24.0, 21, strips=2)
    return list(blocks_from_luminance(rows.level, rows.frame_time_s, Header()))


@pytest.fixture(scope="module")
def idle_together(blocks: Sequence[RowBlock]) -> dict[str, dict[str, Any]]:
    return {name: judge.idle_by(name, blocks, TRUE_RATIO) for name in IDLE_METHODS}


@pytest.mark.parametrize("method", IDLE_METHODS)
def test_idle_methods_say_what_they_say_alone(
    blocks: Sequence[RowBlock], idle_together: dict[str, dict[str, Any]], method: str
) -> None:
    stage = make_idle(IdleSettings(method=method))
    alone = [m for block in blocks for m in stage.update(block)] + stage.flush()
    together = idle_together[method]
    assert together["verdict"] == alone[-1].verdict
    assert together["reason"] == alone[-1].reason
    if np.isfinite(alone[-1].idle_ratio):
        assert together["idle_percent"] == pytest.approx(100 * alone[-1].idle_ratio, abs=1e-7)
        error = 100 * (alone[-1].idle_ratio - TRUE_RATIO)
        assert together["error_percent"] == pytest.approx(error, abs=1e-7)
        std = 100 * np.sqrt(alone[-1].idle_ratio_var)
        assert together["std_percent"] == pytest.approx(std, abs=1e-7)


def test_enf_errors_are_against_the_mean_of_the_second_around_each_value(
    blocks: Sequence[RowBlock],
) -> None:
    found = judge.enf_by("stft", blocks, GRID)
    # On a grid that is higher throughout, every error is as much lower.
    higher = GridPath(GRID.freq_hz + 0.05, GRID.step_s, GRID.start_s)
    lower = judge.enf_by("stft", blocks, higher)
    assert len(found["t_s"]) == len(found["std_mhz"]) == 5
    assert found["t_s"][0] == pytest.approx(10.0)
    assert np.subtract(lower["error_mhz"], found["error_mhz"]) == pytest.approx(-50.0, abs=1e-4)


def test_a_method_that_breaks_is_a_result(
    blocks: Sequence[RowBlock], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any) -> Any:
        raise ZeroDivisionError("nothing there")

    class Broken(StftTracker):
        update = broken

    monkeypatch.setitem(judge.IDLE_METHODS._items, "broken", broken)
    monkeypatch.setitem(judge.ENF_METHODS._items, "broken", Broken)
    broke = {"broke": "ZeroDivisionError: nothing there"}
    assert judge.idle_by("broken", blocks, TRUE_RATIO) == broke
    assert judge.enf_by("broken", blocks, GRID) == broke
    assert judge.idle_by("coherent", blocks, TRUE_RATIO)["verdict"] == "estimated"
    assert judge.enf_by("stft", blocks, GRID)["t_s"]


@pytest.mark.parametrize("method", IDLE_METHODS)
def test_rows_that_no_idle_method_can_take_are_a_result(method: str) -> None:
    found = judge.idle_by(method, [None], TRUE_RATIO)  # type: ignore[list-item]  # on purpose
    assert found["broke"].startswith("AttributeError")


def test_seconds_after_lost_frames_are_judged_by_the_time_that_passed() -> None:
    """Three frames are lost, stamps silent: by these, later seconds would be 0.1 s too early."""
    filmed = film(
        trial("frames lost", 22018, rate="24000/1001", nominal_hz=50.0, grid="continental")
    )
    blocks = list(blocks_from_luminance(filmed.level, filmed.stamp_s, Header()))
    found = judge.enf_by("projection", blocks, filmed)
    relative = np.array(found["error_mhz"]) / np.array(found["std_mhz"])
    assert relative.size > 50
    assert np.sqrt(np.mean(relative**2)) < 1.7
