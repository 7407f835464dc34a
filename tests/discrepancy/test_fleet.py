"""A camera from many recordings: on a foreign camera, under lamps and scenes of their own."""

from __future__ import annotations

import dataclasses
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import rsenf
from rsenf.batch.columns import _is_sound
from rsenf.discrepancy.fleet import Common, camera_of, fit_to, pooled, without_series
from rsenf.errors import EXIT_DONE, EXIT_USAGE, InputError, UsageError
from rsenf.model import CaptureModel
from tests.discrepancy.foreign_camera.camera import take
from tests.discrepancy.foreign_camera.cases import Case, drawn_for, plan_of

RECORDINGS = (31_000, 31_001, 31_002)  # seeds that nothing was developed on
IDLE = "shutter.idle_ratio"


def recorded(seed: int, idle_ratio: float) -> dict[str, Any]:
    """What ``discover`` finds in a foreign camera's recording of another lamp, scene and grid."""
    case = Case(seed=seed, rows=120, strips=2, duration_s=12.0, rate="30", nominal_hz=50.0)
    plan, _ = plan_of(case)
    plan.sensor = dataclasses.replace(plan.sensor, idle_ratio=idle_ratio, exposure_s=1e-3)
    plan.readout_s = np.full(len(plan.start_s), plan.sensor.readout_s)
    level = take(plan, drawn_for(case, "noise"))
    return without_series(rsenf.discover(level, frame_time_s=plan.stamp_s).model)


@pytest.fixture(scope="module")
def camera() -> CaptureModel:
    return camera_of([recorded(seed, 0.31) for seed in RECORDINGS])


def test_a_recording_of_the_camera_fits_and_one_of_another_does_not(camera: CaptureModel) -> None:
    common = Common(**camera.provenance["common"][IDLE])
    assert abs(common.deviation(0.31, 0.0)[0]) < 4.0
    assert camera.shutter.idle_ratio == common.mean
    same, other = (fit_to(camera, recorded(31_010, idle)) for idle in (0.31, 0.325))
    assert (same["verdict"], same["p_value"] > 0.01) == ("fits", True)
    assert (other["verdict"], other["parameters"][0]["name"]) == ("differs", IDLE)


def test_the_stated_spread_and_p_values_are_right() -> None:
    rng = np.random.default_rng(31)
    n, spread, stderr = 6, 0.02, 0.01
    found, p_values = [], []
    for _ in range(1000):
        value = rng.normal(1.0, np.hypot(spread, stderr), n + 1)
        one = pooled(value[:n], np.full(n, stderr))
        found.append(one.spread**2)
        p_values.append(one.deviation(float(value[n]), stderr)[1])
    assert np.mean(found) == pytest.approx(spread**2, rel=0.15)
    for limit in (0.5, 0.05):
        share = np.mean(np.array(p_values) < limit)
        assert stats.binomtest(int(share * 1000), 1000, limit).pvalue > 1e-3


def plain(idle_ratio: float = 0.3, **effects: dict[str, Any]) -> dict[str, Any]:
    model = CaptureModel().changed(size=(64, 48), frame_rate=30, idle_ratio=idle_ratio)
    for name, values in effects.items():
        model = model.with_effect(name, **values)
    errors = {IDLE: 1e-4, "rows_cropped.crop_ratio": 1e-4, "second_lamp.weight": 1e-4}
    return without_series(dataclasses.replace(model, provenance={"stderr": errors}))


def test_what_is_the_cameras_and_what_is_each_recordings_own() -> None:
    crop = {"crop_ratio": 0.1}
    made = [plain(rows_cropped=crop, second_lamp={"weight": w}) for w in (0.1, 0.2)]
    camera = camera_of([*made, plain(rows_cropped=crop, exposure={})])
    assert [effect.name for effect in camera.effects] == ["rows_cropped"]
    assert set(camera.provenance["common"]) == {IDLE, "rows_cropped.crop_ratio"}
    assert camera.provenance["other_effects"] == {"second_lamp": 2, "exposure": 1}
    assert CaptureModel.from_dict(camera.to_dict()) == camera
    assert fit_to(camera, made[0])["verdict"] == "fits"
    other = fit_to(camera, plain(rows_cropped={"crop_ratio": 0.12}))
    worst = other["parameters"][0]["name"]
    assert (other["verdict"], worst) == ("differs", "rows_cropped.crop_ratio")


def test_undecided_where_the_mode_or_the_effects_are_others() -> None:
    camera = camera_of([plain(), plain(), plain()])
    faster = plain()
    faster["shutter"] = faster["shutter"] | {"frame_rate": "60"}
    bent = fit_to(camera, plain(gamma={}))
    means = plain()
    del means["provenance"]["stderr"][IDLE]
    for fit, why in (
        (fit_to(camera, faster), "another mode"),
        (bent, "it has gamma"),
        (fit_to(camera, means), "one mean a frame"),
    ):
        assert fit["verdict"] == "undecided"
        assert why in fit["reason"]
    with pytest.raises(InputError, match="several modes"):
        camera_of([plain(), faster])
    with pytest.raises(InputError, match="two recordings"):
        camera_of([plain()])
    with pytest.raises(UsageError, match="no model of a camera"):
        fit_to(CaptureModel(), plain())
    for name, wrong in (("mean", "0.3"), ("stderr", np.nan), ("spread", np.inf), ("freedom", 0)):
        common = camera.provenance["common"]
        edited = {**camera.provenance, "common": {IDLE: common[IDLE] | {name: wrong}}}
        with pytest.raises(UsageError, match=f"{IDLE} of the camera's model"):
            fit_to(dataclasses.replace(camera, provenance=edited), plain())


def test_what_a_batch_keeps_is_json_and_a_damaged_row_is_seen() -> None:
    unknown = {IDLE: 1e-4, "rows_cropped.crop_ratio": np.inf}
    kept = without_series(dataclasses.replace(CaptureModel(), provenance={"stderr": unknown}))
    assert json.loads(json.dumps(kept, allow_nan=False)) == kept
    row = {"analysis": "discover", "path": "/a.npz", "status": "done"}
    assert _is_sound(row | {"model": kept})
    for wrong in (5, "text", {"shuttr": {}}):
        assert not _is_sound(row | {"model": wrong})


def test_clocks_are_compared_at_one_rate_as_written_only() -> None:
    def at(rate: str, ppm: float) -> dict[str, Any]:
        one = plain(clock_skew={"clock_ppm": ppm})
        one["shutter"] = one["shutter"] | {"frame_rate": rate}
        one["provenance"]["stderr"] |= {"clock_skew.clock_ppm": 1.0}
        return one

    camera = camera_of([at("30", 20.0), at("30", 20.5), at("30", 19.5)])
    assert set(camera.provenance["common"]) == {IDLE, "clock_skew.clock_ppm"}
    assert fit_to(camera, at("30", 120.0))["verdict"] == "differs"
    assert fit_to(camera, at("30000/1001", 1020.0))["verdict"] == "fits"
    mixed = camera_of([at("30", 20.0), at("30000/1001", 1020.0)])
    assert set(mixed.provenance["common"]) == {IDLE}


def test_a_batch_writes_it_and_a_recording_is_compared(
    rsenf: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    clip = ["--duration-s", "8", "--size", "64x48", "--lamp", "tone"]
    for seed, name in enumerate(("a", "b", "other")):
        idle = "0.2" if name == "other" else "0.35"
        out = tmp_path / f"{name}.npz"
        made = rsenf("simulate", "--out", out, *clip, "--seed", seed, "--idle-ratio", idle)
        assert made.returncode == EXIT_DONE, made.stderr
    batch = ("batch", "discover", tmp_path / "a.npz", tmp_path / "b.npz", "--one-camera")
    done = rsenf(*batch, "--out", tmp_path / "found")
    assert done.returncode == EXIT_DONE, done.stderr
    assert f"{IDLE} 0.3" in done.stdout
    model = tmp_path / "found" / "camera.yaml"
    fits = ("--fits", model, "--json")
    found = rsenf("discover", tmp_path / "other.npz", "--out", tmp_path / "other", *fits)
    assert json.loads(found.stdout)["camera"]["verdict"] == "differs"
    assert "model: differs" in (tmp_path / "other/report.html").read_text()
    wrong = rsenf("discover", tmp_path / "a.npz", "--out", tmp_path / "w", "--fits", tmp_path / "a")
    assert wrong.returncode == EXIT_USAGE
