"""Results can't be changed, become tables where these are wanted, and progress is told."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest
import scipy.linalg  # noqa: F401  loaded, so that its threads are counted
from threadpoolctl import threadpool_info, threadpool_limits

import rsenf
from rsenf.api import shared
from rsenf.api.simulate import SimulateResult
from rsenf.errors import UsageError
from rsenf.model import synthetic_grid

GRID_HZ = synthetic_grid(seed=5, duration_s=400).freq_hz


@pytest.fixture(scope="module")
def made() -> SimulateResult:
    return rsenf.simulate(
        reference=GRID_HZ, step_s=1.0, start_s=100.0, duration_s=60, size=(64, 48), seed=7
    )


def results(made: SimulateResult) -> list[Any]:
    given = {"recording": made.rows, "frame_time_s": made.frame_time_s}
    dated = {"step_s": 1.0, "reference_start": "2026-01-15T10:00:00Z"}
    tracked = rsenf.track(**given)
    return [
        made,
        tracked,
        rsenf.verify(**given, reference=GRID_HZ, step_s=1.0),
        rsenf.live(**given, reference=GRID_HZ, **dated, start="2026-01-15T10:01:40Z"),
        rsenf.idle(**given),
        rsenf.verify_against(tracked, tracked),
    ]


def test_results_are_frozen_and_plain(made: SimulateResult) -> None:
    for result in results(made):
        name = dataclasses.fields(result)[0].name
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(result, name, None)
        json.dumps(result.to_dict(), allow_nan=False)
        assert str(result)
        assert "\n" not in repr(result)
    for array in (made.rows, made.frame_time_s, rsenf.track(made.rows, frame_rate_hz=30.0).enf_hz):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_one_blas_thread_and_then_the_callers_number_again(made: SimulateResult) -> None:
    def threads() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    inside: set[int] = set()
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        rsenf.track(made.rows, frame_rate_hz=30.0, on_estimate=lambda _: inside.update(threads()))
        assert threads() == before == {2}
    assert inside == {1}


def test_tables_of_pandas(made: SimulateResult) -> None:
    pytest.importorskip("pandas", reason="pip install 'rsenf[pandas]'")
    _, tracked, verified, live, *_ = results(made)
    table = tracked.to_pandas()
    assert table.index.name == "t_s"
    assert np.array_equal(table["enf_hz"], tracked.enf_hz, equal_nan=True)
    assert verified.to_pandas().index[0] == verified.lag_s
    assert live.to_pandas()["verdict"].iloc[-1] == live.verdict


def test_arrays_of_xarray(made: SimulateResult) -> None:
    pytest.importorskip("xarray", reason="pip install 'rsenf[xarray]'")
    held = rsenf.read_recording(made.rows, frame_time_s=made.frame_time_s)
    for array in (made.to_xarray(), held.to_xarray()):
        assert array.dims == ("frame_time_s", "row", "strip")
        assert np.array_equal(array.values, made.rows)
        first = array.sel(frame_time_s=slice(0.0, 0.99))
        assert first.sizes["frame_time_s"] == 30


def test_a_missing_package_is_one_line(
    made: SimulateResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(shared.importlib, "import_module", missing)
    tracked = rsenf.api.track.track(made.rows, frame_time_s=made.frame_time_s)  # type: ignore[attr-defined]
    with pytest.raises(UsageError, match=r"^pandas is not installed \(pip install 'rsenf\[pandas"):
        tracked.to_pandas()
    with pytest.raises(UsageError, match=r"xarray is not installed"):
        made.to_xarray()


def test_progress_is_told_in_seconds() -> None:
    filmed: list[float] = []
    made = rsenf.simulate(duration_s=12, size=(64, 48), progress=filmed.append)
    read: list[float] = []
    rsenf.track(made.rows, frame_time_s=made.frame_time_s, progress=read.append)
    for told in (filmed, read):
        assert told == sorted(told)
        assert len(told) > 2
        assert math.isclose(told[-1], 12.0, abs_tol=0.1)


def test_discovery_tells_each_step_once_and_how_far_it_is(made: SimulateResult) -> None:
    steps: list[str] = []
    shares: list[float] = []

    def doing(step: str) -> None:
        steps.append(step)
        shares.append(-1.0)

    rsenf.discover(made.rows, frame_time_s=made.frame_time_s, doing=doing, share=shares.append)
    assert steps[:2] == ["fitting the model", "looking for what is missing"]
    assert all(steps)
    rounds = " ".join(map(str, shares)).split("-1.0")
    of_each = [[float(share) for share in one.split()] for one in rounds]
    assert all(one == sorted(one) and one[:1] in ([], [0.0]) for one in of_each)
    assert 0.3 < max(map(max, filter(None, of_each))) < 1.0


def test_a_settings_class_says_the_same_as_a_keyword(made: SimulateResult) -> None:
    from rsenf.track import TrackSettings

    given = {"recording": made.rows, "frame_time_s": made.frame_time_s}
    by_name = rsenf.track(**given, method="stft", nominal_hz=50.0)
    by_settings = rsenf.track(**given, settings=TrackSettings("stft", nominal_hz=50.0))
    assert by_name.to_dict() == by_settings.to_dict()
    assert by_name.to_dict() != rsenf.track(**given).to_dict()


def test_a_grid_that_is_assumed_by_the_frame_rate_is_noted() -> None:
    made = rsenf.simulate(duration_s=40, seed=5, size=(64, 48), frame_rate=25)
    for nominal_hz, is_noted in ((None, True), (50.0, False)):
        found = rsenf.track(made.rows, frame_time_s=made.frame_time_s, nominal_hz=nominal_hz)
        assert found.usable.any()
        assert any("as that of a 50 Hz grid" in line for line in found.warnings) is is_noted
