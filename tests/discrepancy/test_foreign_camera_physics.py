"""The foreign camera against closed forms: what it films is what it says it films."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.discrepancy.foreign_camera import (
    EFFECTS,
    NEUTRAL,
    UNKNOWN,
    Case,
    Filmed,
    as_video,
    draw_case,
    film,
    go_together,
    shoot,
    video_case,
)

Array = NDArray[np.float64]
SEEDS = range(4)
SMALL: dict[str, Any] = {"rows": 240, "duration_s": 20.0}


def _small(*hidden: str, lamp: str = "tone", **more: Any) -> Case:
    return Case(hidden=hidden, lamp=lamp, **{**SMALL, **more})


def _pair(name: str, **more: Any) -> tuple[Filmed, Filmed, dict[str, Any]]:
    """Film without noise, without and with an effect."""
    case = _small(name, **more)
    filmed = shoot(case, noisy=False)
    return shoot(replace(case, hidden=()), noisy=False), filmed, filmed.hidden[name]


def _relative(filmed: Filmed) -> Array:
    """Level over each row's mean, less one."""
    level = filmed.level.astype(float)
    return np.asarray(level / level.mean(axis=0) - 1)


def _rows_s(filmed: Filmed) -> Array:
    lines = np.arange(filmed.level.shape[1]) / filmed.level.shape[1]
    return np.asarray(filmed.stamp_s[:, None] + filmed.truth["readout_s"] * lines)


def _ramp(filmed: Filmed) -> Array:
    lines = _rows_s(filmed)[0] - filmed.stamp_s[0]
    return np.asarray(np.exp(-2j * np.pi * filmed.truth["f0_mean_hz"] * lines))


def _of_frames(filmed: Filmed, strip: int = 0) -> Array:
    """Amplitude of the first harmonic in each frame, from a fit of it, its mirror and a level."""
    ramp = _ramp(filmed)
    basis = np.stack([ramp.conj() / 2, ramp / 2, np.ones_like(ramp)], axis=1)
    return np.asarray((_relative(filmed)[:, :, strip] @ np.linalg.pinv(basis).T)[:, 0])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_first_harmonic_stands_at_its_alias(seed: int) -> None:
    filmed = film(_small(seed=seed, duration_s=40.0))
    row = _relative(filmed)[:, 17, 0]
    hz = np.fft.rfftfreq(8 * len(row), 1 / filmed.truth["frame_rate"])
    peak_hz = hz[np.argmax(np.abs(np.fft.rfft(row * np.hanning(len(row)), 8 * len(row))))]
    folds = filmed.truth["f0_mean_hz"] - np.arange(8) * filmed.truth["frame_rate"]
    assert np.abs(folds).min() == pytest.approx(filmed.truth["alias_hz"], abs=1e-9)
    assert peak_hz == pytest.approx(np.abs(folds).min(), abs=0.02)


@pytest.mark.parametrize("hidden", [(), ("reverse_readout",), ("rows_cropped",)])
def test_phase_runs_down_the_rows_as_they_are_read(hidden: tuple[str, ...]) -> None:
    filmed = film(_small(*hidden, seed=1, rows=720))
    tone = np.exp(-2j * np.pi * filmed.truth["f0_mean_hz"] * filmed.stamp_s)
    phase = np.unwrap(np.angle(tone @ _relative(filmed)[:, :, 0]))
    slope = np.polyfit(np.arange(720), phase, 1)[0]
    expected = 2 * np.pi * filmed.truth["f0_mean_hz"] * filmed.truth["readout_s"] / 720
    assert slope == pytest.approx(-expected if "reverse_readout" in hidden else expected, rel=1e-3)
    assert filmed.truth["idle_ratio"] == pytest.approx(
        1 - filmed.truth["readout_s"] * filmed.truth["frame_rate"]
    )


def test_exposure_attenuates_each_harmonic_by_its_sinc() -> None:
    before, after, _ = _pair("exposure", lamp="led", seed=3)
    f0_hz = before.truth["f0_mean_hz"]
    ratio = after.truth["flicker_ratio"] / before.truth["flicker_ratio"]
    first = [np.sinc(f0_hz * filmed.truth["exposure_s"]) for filmed in (before, after)]
    assert ratio == pytest.approx(first[1] / first[0], rel=1e-6)
    second = [np.sinc(2 * f0_hz * filmed.truth["exposure_s"]) for filmed in (before, after)]
    shrinks = after.truth["harmonics"][1] / before.truth["harmonics"][1]
    assert shrinks == pytest.approx(abs(second[1] / second[0] / ratio), rel=1e-6)
    for filmed in (before, after):
        rows_s = _rows_s(filmed)[:30]
        fit = 2 * np.exp(-2j * np.pi * f0_hz * rows_s) * _relative(filmed)[:30, :, 0]
        assert abs(fit.mean()) == pytest.approx(filmed.truth["flicker_ratio"], rel=0.05)


def test_integrated_light_is_the_mean_over_the_exposure() -> None:
    from tests.discrepancy.foreign_camera import camera, cases

    plan, _ = cases.plan_of(_small("pwm_tone", seed=2, lamp="led", rows=240, times=40.0))
    moment = camera.moment_of(plan, np.arange(3))
    once = camera.light(plan, moment)
    exposure_s = plan.sensor.exposure_s
    plan.sensor = replace(plan.sensor, exposure_s=0.0)
    at_s = (np.arange(400) + 0.5) / 400 - 0.5
    parts = [
        camera.light(plan, replace(moment, t_s=moment.t_s + exposure_s * share)) for share in at_s
    ]
    assert np.abs(np.mean(parts, axis=0) - once).max() < 2e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_light_moves_with_the_grid(seed: int) -> None:
    filmed = shoot(_small(lamp="led", seed=seed, rows=720, duration_s=60.0), noisy=False)
    hz = np.array(filmed.truth["grid_hz"])
    assert hz.mean() * 2 == pytest.approx(filmed.truth["f0_mean_hz"], abs=1e-3)
    assert np.abs(hz - filmed.truth["nominal_hz"]).max() < 0.1
    assert np.abs(np.diff(hz)).max() < 0.004
    phase = np.unwrap(np.angle(_of_frames(filmed) / np.exp(4j * np.pi * hz[0] * filmed.stamp_s)))
    turned = 4 * np.pi * np.concatenate([[0.0], np.cumsum(hz - hz[0])])
    seconds = np.arange(len(turned))
    assert _rms(phase - phase[0] - np.interp(filmed.stamp_s, seconds, turned)) < 0.03
    assert sum(part > 0 for part in filmed.truth["harmonics"]) >= 8


def test_a_lost_frame_turns_the_phase() -> None:
    whole, gapped, told = _pair("frame_drop", seed=5)
    turn = 2 * np.pi * whole.truth["f0_mean_hz"] / whole.truth["frame_rate"]
    lost = sum(told["frames_lost"])
    assert len(whole.level) - len(gapped.level) == lost
    before, after = _of_frames(whole), _of_frames(gapped)
    at = told["at_frames"][0]
    np.testing.assert_allclose(after[:at], before[:at], rtol=5e-3)
    turned = np.angle(after[-1] / before[len(after) - 1])
    assert np.exp(1j * turned) == pytest.approx(np.exp(1j * turn * lost), abs=0.02)


def test_a_frame_is_repeated_with_its_noise() -> None:
    filmed = film(_small("frame_duplicate", seed=5))
    same = np.flatnonzero((np.diff(filmed.level, axis=0) == 0).all(axis=(1, 2))) + 1
    assert same.tolist() == filmed.hidden["frame_duplicate"]["at_frames"]


@pytest.mark.parametrize("seed", SEEDS)
def test_noise_is_of_electrons_reading_and_rounding(seed: int) -> None:
    case = _small(seed=seed)
    truth, clean = film(case).truth, shoot(case, noisy=False).level.astype(float)
    noise = film(case).level - clean
    per_electron = 255 / truth["well_electrons"]
    pixel = clean * per_electron + (truth["read_electrons"] * per_electron) ** 2 + 1 / 12
    expected = pixel / truth["pixels"] + truth["row_noise_level"] ** 2
    assert np.mean(noise**2 / expected) == pytest.approx(1.0, abs=0.01)
    shared = np.mean(noise[:, :, 0] * noise[:, :, 1])
    error = float(np.mean(expected)) / np.sqrt(noise[:, :, 0].size)
    assert shared == pytest.approx(truth["row_noise_level"] ** 2, abs=4 * error)


@pytest.mark.parametrize("seed", SEEDS)
def test_tones_are_of_the_size_told(seed: int) -> None:
    for name, hz_name in (("pwm_tone", "tone_hz"), ("interharmonic", "flicker_hz")):
        before, after, told = _pair(name, seed=seed)
        if name == "pwm_tone":
            before = shoot(replace(_small(seed=seed), times=0.0, hidden=(name,)), noisy=False)
        more = _relative(after) - _relative(before)
        tone = np.exp(-2j * np.pi * told[hz_name] * _rows_s(after))
        depth = 2 * np.abs(np.mean(tone[:, :, None] * more, axis=(0, 1)))
        strips = np.array(told.get("strip_ratio", [1.0, 1.0]))
        np.testing.assert_allclose(depth / told["depth_ratio"], strips, rtol=0.15)


@pytest.mark.parametrize("seed", SEEDS)
def test_gain_and_pattern_are_of_the_size_told(seed: int) -> None:
    before, after, told = _pair("auto_exposure", seed=seed)
    gain = after.level.mean(axis=(1, 2)) / before.level.mean(axis=(1, 2))
    assert np.std(gain) == pytest.approx(told["gain_rms_ratio"], rel=0.01)
    for name, size_name in (
        ("row_banding", "banding_rms_ratio"),
        ("moving_object", "level_rms_ratio"),
    ):
        before, after, told = _pair(name, seed=seed)
        pattern = (after.level / before.level).astype(float)
        assert _rms(pattern - pattern.mean(axis=0)) == pytest.approx(told[size_name], rel=0.05)


@pytest.mark.parametrize("seed", SEEDS)
def test_times_are_off_by_the_size_told(seed: int) -> None:
    def late_s(before: Filmed, after: Filmed) -> Array:
        turned = np.unwrap(np.angle(_of_frames(after) / _of_frames(before)))
        return np.asarray(turned / (2 * np.pi * before.truth["f0_mean_hz"]))

    before, after, told = _pair("capture_jitter", seed=seed)
    assert np.std(late_s(before, after)) == pytest.approx(told["jitter_s"], rel=0.05)
    before, after, told = _pair("timestamp_jitter", seed=seed)
    assert np.array_equal(before.level, after.level)
    assert np.std(after.stamp_s - before.stamp_s) == pytest.approx(told["jitter_s"], rel=0.01)
    before, after, told = _pair("variable_frame_rate", seed=seed)
    assert np.std(late_s(before, after)) == pytest.approx(told["late_rms_s"], rel=0.05)
    before, after, told = _pair("clock_skew", seed=seed)
    ppm = 1e6 * np.polyfit(before.stamp_s, late_s(before, after), 1)[0]
    assert -ppm == pytest.approx(told["clock_ppm"], rel=0.05)
    before, after, told = _pair("interlace", seed=seed)
    even = np.abs(_relative(after)[:, 0::2] - _relative(before)[:, : 240 // 2]).max()
    odd = np.abs(_relative(after)[:, 1::2] - _relative(before)[:, : 240 // 2]).max()
    assert (even < odd) == told["top_field_first"]


@pytest.mark.parametrize("seed", SEEDS)
def test_read_out_drifts_by_the_size_told(seed: int) -> None:
    before, after, told = _pair("readout_drift", seed=seed)
    was, now = _relative(before)[:, -1, 0], _relative(after)[:, -1, 0]
    rate = 2 * np.pi * before.truth["f0_mean_hz"] * before.truth["flicker_ratio"]
    moved_s = _rms(now - was) * np.sqrt(2) / rate
    assert moved_s / before.truth["readout_s"] == pytest.approx(told["drift_rms_ratio"], rel=0.25)


@pytest.mark.parametrize("seed", SEEDS)
def test_flicker_changes_by_the_size_told(seed: int) -> None:
    before, after, told = _pair("gop_attenuation", seed=seed)
    lost = 1 - np.abs(_of_frames(after) / _of_frames(before))
    assert lost.max() == pytest.approx(told["attenuation_ratio"], rel=0.1)
    period = np.abs(np.fft.rfft(lost - lost.mean()))
    steps = len(lost) / told["period_frames"]
    assert period[max(1, int(steps)) : int(steps) + 2].max() > 5 * np.median(period)
    before, after, told = _pair("gamma", seed=seed)
    slope = np.polyfit(np.log(before.level).ravel()[::99], np.log(after.level).ravel()[::99], 1)[0]
    assert slope == pytest.approx(told["exponent"], rel=1e-3)
    before, after, told = _pair("second_lamp", seed=seed)
    weights = np.array(told["weights"])
    for strip, weight in enumerate(weights):
        mixed = np.mean(_of_frames(after, strip) / _of_frames(before, strip))
        assert mixed == pytest.approx(
            1 - weight + weight * np.exp(1j * told["phase_rad"]), abs=0.006
        )
    filmed = shoot(_small("harmonics", seed=seed), noisy=False)
    assert filmed.truth["harmonics"][1] == pytest.approx(filmed.hidden["harmonics"]["added_ratio"])


def _left_over(case: Case) -> float:
    """Power that a free level of each row and the grid's harmonics leave, to the flicker's."""
    from tests.discrepancy.foreign_camera import camera, cases

    relative = _relative(shoot(case, noisy=False))
    plan, _ = cases.plan_of(replace(case, hidden=()))
    angle = 2 * np.pi * camera.mains(plan, camera.moment_of(plan, np.arange(plan.frames)))
    waves = np.stack([wave(2 * k * angle) for k in range(1, 7) for wave in (np.cos, np.sin)])
    waves = (waves - waves.mean(axis=1, keepdims=True)).reshape(len(waves), -1)
    strips = relative.reshape(-1, relative.shape[2])
    fit = np.linalg.solve(waves @ waves.T, waves @ strips)
    return float(np.mean((strips - waves.T @ fit) ** 2)) / plan.flicker_rms**2


@pytest.mark.parametrize("name", sorted(UNKNOWN))
def test_what_has_no_name_matters(name: str) -> None:
    for seed in SEEDS:
        case = Case(seed=seed, hidden=(name,), lamp="tone", rows=240, duration_s=15.0)
        assert _left_over(replace(case, hidden=())) < 1e-5
        assert 1e-4 < _left_over(case) < 0.1


@pytest.mark.parametrize("name", sorted({**EFFECTS, **UNKNOWN}))
def test_all_of_it_is_told_and_the_same_again(name: str) -> None:
    case = Case(hidden=(name,), seed=7, rows=240, duration_s=8.0, rest=1.0)
    one, other = film(case), film(case)
    assert np.array_equal(one.level, other.level)
    assert one.level.dtype == np.float32
    assert len(one.level) == len(one.stamp_s)
    assert np.isfinite(one.level).all()
    assert one.level.max() < 250
    json.dumps([one.truth, one.hidden])


def test_cases_are_drawn_sensibly() -> None:
    cases = [draw_case(seed) for seed in range(200)]
    shown = [name for case in cases for name in case.hidden]
    assert any(not case.hidden for case in cases)
    assert {"pwm_tone", "second_lamp"} < set(shown)
    assert set(shown) & set(UNKNOWN)
    assert set(shown) & set(NEUTRAL)
    for case in cases:
        assert len(case.hidden) < 2 or go_together(*case.hidden)
        assert "second_lamp" not in case.hidden or case.strips > 1
    assert not go_together("gamma", "harmonics")
    with pytest.raises(ValueError, match="can be hidden"):
        Case(hidden=("gremlins",))


def test_it_loads_by_its_path() -> None:
    path = Path(__file__).parent / "foreign_camera" / "__init__.py"
    spec = importlib.util.spec_from_file_location("judge_camera", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["judge_camera"] = module
    try:
        spec.loader.exec_module(module)
        assert module.film(module.Case(rows=240, duration_s=4.0)).level.ndim == 3
    finally:
        for name in [name for name in sys.modules if name.split(".")[0] == "judge_camera"]:
            del sys.modules[name]


@pytest.mark.external
@pytest.mark.skipif(not shutil.which("ffmpeg"), reason="needs ffmpeg")
def test_a_file_shows_what_was_filmed(tmp_path: Path) -> None:
    case = video_case(Case(seed=3, hidden=("frame_drop",), duration_s=4.0))
    as_video(case, tmp_path / "film.mkv")
    decode = ["ffmpeg", "-loglevel", "error", "-i", str(tmp_path / "film.mkv")]
    decode += ["-f", "rawvideo", "-pix_fmt", "gray", "-"]
    raw = subprocess.run(decode, capture_output=True, check=True).stdout
    luma = np.frombuffer(raw, np.uint8).reshape(-1, case.rows, 128)
    clean = shoot(case, noisy=False).level
    assert len(luma) == len(clean)
    off = luma.reshape(*luma.shape[:2], 2, 64).mean(axis=3) - clean
    assert abs(off.mean()) < 0.01
    assert 0.05 < off.std() < 0.5
