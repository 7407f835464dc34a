"""What the foreign camera has for estimators, against closed forms."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.discrepancy.foreign_camera import (
    CODINGS,
    FILTERS,
    GRIDS,
    HARD,
    KINDS,
    RATES,
    Case,
    Filmed,
    Filter,
    as_video,
    film,
    shoot,
    trial,
)

Array = NDArray[np.float64]
needs_ffmpeg = pytest.mark.skipif(not shutil.which("ffmpeg"), reason="needs ffmpeg")
SEEDS = range(5)
SMALL: dict[str, Any] = {"rows": 240, "duration_s": 20.0, "rate": "30000/1001", "nominal_hz": 50.0}


def _small(*hidden: str, lamp: str = "tone", **more: Any) -> Case:
    return Case(hidden=hidden, lamp=lamp, **{**SMALL, **more})


def _shot(name: str, *others: str, **more: Any) -> tuple[Filmed, dict[str, Any]]:
    filmed = shoot(_small(name, *others, **more), noisy=False)
    return filmed, filmed.hidden[name]


def _relative(filmed: Filmed) -> Array:
    level = filmed.level.astype(float)
    return np.asarray(level / level.mean(axis=0) - 1)


def _turns(filmed: Filmed) -> Array:
    """Turns of the mains at each row, from the truth: frequencies of seconds, evened out."""
    truth = filmed.truth
    rows_s = filmed.stamp_s[:, None] + truth["readout_s"] * (
        np.arange(filmed.level.shape[1]) / filmed.level.shape[1]
    )
    fine_s = np.arange(0.0, filmed.stamp_s[-1] + 1.0, 0.05)
    hz = filmed.mean_hz(fine_s[:-1], fine_s[1:])
    return np.interp(rows_s, fine_s, np.concatenate([[0.0], np.cumsum(0.05 * hz)]))


def _parts(filmed: Filmed, orders: tuple[float, ...], strip: int = 0) -> Array:
    """Sizes of multiples of the mains' frequency, by least squares over all rows."""
    turns, level = _turns(filmed), _relative(filmed)[:, :, strip]
    waves = np.stack([np.exp(2j * np.pi * order * turns).ravel() for order in orders])
    both = np.concatenate([waves.real, waves.imag, np.ones((1, waves.shape[1]))])
    fit = np.linalg.solve(both @ both.T, both @ level.ravel())
    return np.hypot(fit[: len(orders)], fit[len(orders) : 2 * len(orders)])


@pytest.mark.parametrize("seed", SEEDS)
def test_a_second_harmonic_is_as_large_as_told(seed: int) -> None:
    filmed, told = _shot("second_harmonic", seed=seed)
    first, second = _parts(filmed, (2, 4))
    assert second / first == pytest.approx(told["second_ratio"], rel=0.02)
    assert first == pytest.approx(filmed.truth["flicker_ratio"], rel=0.02)
    assert 0.29 < told["second_ratio"] < 3.01


@pytest.mark.parametrize("seed", SEEDS)
def test_half_waves_differ_as_told(seed: int) -> None:
    filmed, told = _shot("half_wave_part", seed=seed)
    half, first, third = _parts(filmed, (1, 2, 3))
    assert half / first == pytest.approx(told["half_ratio"], rel=0.03)
    assert third / first == pytest.approx(told["third_half_ratio"], rel=0.03, abs=1e-3)


def test_sources_of_one_make_add_up_as_phasors() -> None:
    from tests.discrepancy.foreign_camera import camera, cases

    plan, _ = cases.plan_of(_small("several_sources", seed=4, lamp="led"))
    moment = camera.moment_of(plan, np.arange(2))
    once = camera.light(plan, moment) - 1
    alone = []
    for shining in plan.lamps:
        plan.lamps = [replace(shining, share=np.ones(1))]
        alone.append((camera.light(plan, moment) - 1) * shining.share)
    np.testing.assert_allclose(once, sum(alone), atol=1e-12)
    total = sum(np.abs(part).max() for part in alone)
    assert len(alone) > 1
    assert total > np.abs(once).max()


@pytest.mark.parametrize("seed", SEEDS)
def test_pwm_is_a_rectangle_seen_over_the_exposure(seed: int) -> None:
    filmed, told = _shot("pwm", "no_lamp", seed=seed, rows=720)
    rows_s = filmed.truth["readout_s"] * np.arange(720) / 720
    wave = np.exp(-2j * np.pi * told["pwm_hz"] * (filmed.stamp_s[:, None] + rows_s))
    steady = 2 * abs(np.mean(_relative(filmed)[:30, :, 0] * wave[:30]))
    if told["form"] == "crystal":
        strips = [2 * abs(np.mean(_relative(filmed)[..., n] * wave)) for n in range(2)]
        assert steady == pytest.approx(strips[0], rel=0.1)
        assert max(strips) <= told["depth_ratio"] * 1.02
    assert not filmed.truth["mains"]
    duty, exposure_s, hz = told["duty_ratio"], filmed.truth["exposure_s"], told["pwm_hz"]
    # A rectangle's second harmonic to its first, each behind the exposure's sinc.
    expected = np.sin(2 * np.pi * duty) / 2 / np.sin(np.pi * duty)
    expected *= np.sinc(2 * hz * exposure_s) / np.sinc(hz * exposure_s)
    second = 2 * abs(np.mean(_relative(filmed)[:30, :, 0] * wave[:30] ** 2))
    assert second / steady == pytest.approx(abs(expected), abs=0.15)


@pytest.mark.parametrize("nominal_hz", [50.0, 60.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_monitor_has_the_other_grids_rate(seed: int, nominal_hz: float) -> None:
    rate = "23.5"
    filmed, told = _shot("monitor", "no_lamp", seed=seed, nominal_hz=nominal_hz, rate=rate)
    others = (60.0, 120.0) if nominal_hz == 50.0 else (50.0, 100.0)
    assert min(abs(told["refresh_hz"] / other - 1) for other in others) < 2e-3
    row = _relative(filmed)[:, 120, :].sum(axis=1)
    hz = np.fft.rfftfreq(8 * len(row), 1 / 23.5)
    power = np.abs(np.fft.rfft(row * np.hanning(len(row)), 8 * len(row)))
    folds = [
        abs(n * told["refresh_hz"] - 23.5 * np.round(n * told["refresh_hz"] / 23.5))
        for n in range(1, 5)
    ]
    assert np.abs(np.array(folds) - hz[np.argmax(power)]).min() < 0.06


@pytest.mark.parametrize("seed", range(12))
def test_stripes_pass_as_often_as_told(seed: int) -> None:
    filmed, told = _shot("stripes", "no_lamp", seed=seed, rows=720)
    if told["form"] != "even":
        return
    rate, hz = filmed.truth["frame_rate"], told["periods_a_second"]
    signed = hz - rate * np.round(hz / rate)
    wave = np.exp(2j * np.pi * signed * filmed.stamp_s)
    phase = np.unwrap(np.angle(wave @ _relative(filmed)[:, :, 0]))
    # Down the picture, and on while it is read.
    slope = 2 * np.pi * (told["periods_a_picture"] - hz * filmed.truth["readout_s"]) / 720
    assert np.polyfit(np.arange(720), phase, 1)[0] == pytest.approx(slope, rel=0.02, abs=1e-4)


@pytest.mark.parametrize("name", ["vibration", "hand_tilt"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_picture_shakes_as_far_as_told(seed: int, name: str) -> None:
    from tests.discrepancy.foreign_camera import camera, cases

    plan, hidden = cases.plan_of(_small(name, "no_lamp", seed=seed))
    assert plan.shift_rows is not None
    moment = camera.moment_of(plan, np.arange(plan.frames))
    rows, told = plan.shift_rows(moment), hidden[name]
    size = told["tilt_rms_rows" if name == "hand_tilt" else "wobble_rms_rows"]
    assert np.std(rows) == pytest.approx(size, rel=0.05)
    # Where the wall is a slope, it moves as many levels.
    plan.wall = np.add.outer(np.arange(240.0), [50.0, 60.0]) / 2
    far = int(np.ceil(np.abs(rows).max()))
    if far < 100:
        shown = camera.take(plan, np.random.default_rng(0), noisy=False)[:, far : 240 - far]
        np.testing.assert_allclose(shown[..., 0] - plan.wall[far : 240 - far, 0],
                                   -rows[:, far : 240 - far] / 2, atol=1e-3)  # fmt: skip


@pytest.mark.parametrize("seed", SEEDS)
def test_levels_step_and_pulse_as_told(seed: int) -> None:
    filmed, told = _shot("gain_steps", "no_lamp", seed=seed)
    gain = np.log(filmed.level.mean(axis=(1, 2)) / filmed.level[0].mean())
    for index, end_s in enumerate([*told["step_s"][1:], 99.0]):
        begin_s = told["step_s"][index]
        settled = (filmed.stamp_s + 0.5 > begin_s + 1) & (filmed.stamp_s + 0.5 < end_s - 1)
        if settled.any():
            np.testing.assert_allclose(gain[settled], told["log_gain"][index + 1], atol=0.02)
    filmed, told = _shot("key_dimming", "no_lamp", seed=seed)
    mean = filmed.level.mean(axis=(1, 2)) / np.median(filmed.level.mean(axis=(1, 2))) - 1
    peaks = np.flatnonzero(np.abs(mean) > 0.9 * np.abs(mean).max())
    assert set(np.diff(peaks).tolist()) == {told["period_frames"]}


@pytest.mark.parametrize("rate", ["30000/1001", "60", "25"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_conversion_shows_the_nearest_frames(seed: int, rate: str) -> None:
    before = shoot(_small(seed=seed, rate=rate), noisy=False)
    filmed, told = _shot("converted", seed=seed, rate=rate)
    assert filmed.truth["file_rate"] == told["file_rate"] != pytest.approx(float(Fraction(rate)))
    for index in (0, 7, 50, len(filmed.level) - 1):
        if told["form"] == "nearest":
            shown = np.argmin(np.abs(before.stamp_s - filmed.stamp_s[index] - 1e-9))
        else:
            rounded = np.floor(before.stamp_s * told["file_rate"] + 0.5 + 1e-6)
            shown = np.flatnonzero(rounded <= index)[-1]
        np.testing.assert_array_equal(filmed.level[index], before.level[shown])
    mixed, told = _shot("blended", seed=seed, rate=rate)
    for index in (3, 11, 70):
        at = mixed.stamp_s[index] * float(Fraction(rate))
        first, share = int(at), at % 1
        wanted = (1 - share) * before.level[first] + share * before.level[first + 1]
        np.testing.assert_allclose(mixed.level[index], wanted, rtol=1e-5)
    assert mixed.truth["readout_s"] == before.truth["readout_s"]
    assert len(mixed.level) == int(20.0 * told["file_rate"] + 1e-6) or len(mixed.level) > 400


@pytest.mark.parametrize("seed", SEEDS)
def test_stamps_jump_as_far_as_told(seed: int) -> None:
    before = shoot(_small(seed=seed), noisy=False)
    filmed, told = _shot("stamp_jitter", seed=seed)
    np.testing.assert_array_equal(before.level, filmed.level)
    assert told["jitter_s"] == pytest.approx(4e-3)
    assert np.std(filmed.stamp_s - before.stamp_s) == pytest.approx(4e-3, rel=0.06)
    assert (np.diff(filmed.stamp_s) > 0).all()


@pytest.mark.parametrize("seed", range(8))
def test_a_variable_rate_is_told_by_the_stamps(seed: int) -> None:
    filmed, told = _shot("true_variable_rate", seed=seed)
    assert len(filmed.level) == len(filmed.stamp_s)
    assert np.diff(filmed.stamp_s).min() >= 1 / filmed.truth["frame_rate"] - 1e-9
    assert told["mean_rate"] < filmed.truth["frame_rate"]
    fit = _parts(filmed, (2,))
    assert fit[0] == pytest.approx(filmed.truth["flicker_ratio"], rel=0.02)


@pytest.mark.parametrize("name", ["frame_drop", "frame_duplicate"])
def test_the_grid_is_told_on_the_files_clock(name: str) -> None:
    whole = shoot(_small(seed=6, duration_s=40.0), noisy=False)
    filmed, told = _shot(name, seed=6, duration_s=40.0, times=1.0)
    at = told["at_frames"][0] / whole.truth["frame_rate"]
    true, said = np.array(whole.truth["grid_hz"]), np.array(filmed.truth["grid_hz"])
    np.testing.assert_allclose(said[: int(at)], true[: int(at)], atol=1e-9)
    # Afterwards it is late, or early, by some frames.
    frames = sum(told["frames_lost"]) if name == "frame_drop" else -1
    late_s = frames / whole.truth["frame_rate"]
    after_s = np.arange(np.ceil(at) + 1, 37)
    wanted = whole.mean_hz(after_s + late_s, after_s + 1 + late_s)
    np.testing.assert_allclose(filmed.mean_hz(after_s, after_s + 1), wanted, atol=1e-9)
    # And the second in which they are missing isn't off by their turns.
    assert np.abs(said[:40] - true[: len(said)]).max() < 5e-3


@pytest.mark.parametrize("seed", SEEDS)
def test_a_rough_grid_bends_as_asked(seed: int) -> None:
    def bend_hz(case: Case) -> float:
        return float(np.std(np.diff(shoot(case, noisy=False).truth["grid_hz"], 2)))

    case = _small(seed=seed, rows=4, duration_s=400.0)
    for asked_hz in GRIDS.values():
        assert bend_hz(replace(case, rough_hz=asked_hz)) == pytest.approx(asked_hz, rel=0.1)


@pytest.mark.parametrize("name", sorted(HARD))
def test_all_of_it_is_told_and_the_same_again(name: str) -> None:
    case = Case(hidden=(name,), seed=7, rows=120, duration_s=8.0)
    one, other = film(case), film(case)
    np.testing.assert_array_equal(one.level, other.level)
    assert len(one.level) == len(one.stamp_s)
    assert np.isfinite(one.level).all()
    assert one.level.max() < 250
    json.dumps([one.truth, one.hidden])


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_trials_are_drawn_at_every_rate(kind: str) -> None:
    cases = [trial(kind, seed, duration_s=4.0) for seed in range(60)]
    assert {case.rate for case in cases} <= set(RATES)
    assert len({(case.rate, case.nominal_hz, case.rough_hz) for case in cases}) > 15
    filmed = film(replace(cases[0], rows=60))
    assert filmed.truth["mains"] == KINDS[kind].mains
    assert trial(kind, 3, rate="25", nominal_hz=60.0, grid="rough").rough_hz == GRIDS["rough"]


def _luma(path: Path, rows: int, columns: int) -> NDArray[np.uint8]:
    decode = ["ffmpeg", "-loglevel", "error", "-i", str(path), "-f", "rawvideo"]
    decode += ["-pix_fmt", "gray", "-"]
    raw = subprocess.run(decode, capture_output=True, check=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, rows, columns)


@pytest.mark.external
@needs_ffmpeg
@pytest.mark.parametrize("coding", ["lossless", "50k"])
def test_a_converted_film_is_a_file(tmp_path: Path, coding: str) -> None:
    case = Case(hidden=("converted",), seed=3, duration_s=4.0, rows=200, rate="24", strips=2)
    as_video(case, tmp_path / "film.mkv", coding=coding, columns=160)
    luma = _luma(tmp_path / "film.mkv", 200, 160)
    clean = shoot(case, noisy=False).level
    assert coding in CODINGS
    assert len(luma) == len(clean)
    off = luma.reshape(*luma.shape[:2], 2, 80).mean(axis=3) - clean
    assert abs(off.mean()) < 0.5
    same = (luma[1:] == luma[:-1]).all(axis=(1, 2))
    doubled = (clean[1:] == clean[:-1]).all(axis=(1, 2))
    if coding == "lossless":
        np.testing.assert_array_equal(same, doubled)


@pytest.mark.external
@needs_ffmpeg
@pytest.mark.parametrize(("name", "seed"), [("converted", 0), ("converted", 3), ("blended", 5)])
def test_ffmpeg_converts_as_the_camera_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, seed: int
) -> None:
    case = Case(hidden=(name,), seed=seed, duration_s=4.0, rows=160, rate="30000/1001", strips=1)
    made = shoot(case, noisy=False)
    assert made.hidden[name].get("form") in ("last", None)
    rate = Fraction(made.truth["file_rate"]).limit_denominator(1001)
    chain = f"fps={rate}" if name == "converted" else f"minterpolate=fps={rate}:mi_mode=blend"
    monkeypatch.setitem(FILTERS, "theirs", Filter(passes=(chain,)))
    as_video(case, tmp_path / "ours.mp4", columns=64)
    as_video(replace(case, hidden=(), filtered="theirs"), tmp_path / "theirs.mp4", columns=64)
    ours, theirs = (_luma(tmp_path / f"{who}.mp4", 160, 64) for who in ("ours", "theirs"))
    count = min(len(ours), len(theirs))
    assert count > 3.8 * rate
    assert np.abs(ours[:count].astype(int) - theirs[:count]).max() <= 1
