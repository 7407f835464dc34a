from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.model import (
    CaptureModel,
    GridPath,
    Light,
    Scene,
    Sensor,
    Shutter,
    simulate_rows,
    synthetic_grid,
)

PURE = Light(lamp="tone", flicker_ratio=0.5, phase_rad=0.4)
FLAT = Scene(texture_ratio=0.0, vignetting_ratio=0.0)
QUIET = Sensor(white_e=1e6, read_noise_e=0.0)
STEADY = GridPath(np.full(20, 50.0))


def plain(**shutter: object) -> CaptureModel:
    base = {"rows": 240, "columns": 320, **shutter}
    return CaptureModel(light=PURE, scene=FLAT, sensor=QUIET, shutter=Shutter(**base))


def slow_line(series: np.ndarray, sample_rate_hz: float, freq_hz: float) -> float:
    """Amplitude of one line by the sum that defines it, no window, no transform."""
    t_s = np.arange(series.size) / sample_rate_hz
    return 2 * abs(np.mean(series * np.exp(-2j * np.pi * freq_hz * t_s)))


@pytest.mark.parametrize("idle_ratio", [0.0, 0.05, 0.21, 0.38, 0.5, 0.72, 0.9])
@pytest.mark.parametrize(("frame_rate", "nominal_hz"), [(30, 50), (24, 50), (50, 60), (25, 60)])
def test_lines_of_the_concatenated_rows(
    idle_ratio: float, frame_rate: int, nominal_hz: int
) -> None:
    # Paper, large L: the line at f0 - m·Fr has the amplitude |sinc(c - m)|, c = f0·ρ/Fr.
    # These rates put the lines of +f0, those of -f0 and the direct current at different places.
    f0_hz = 2.0 * nominal_hz
    model = plain(frame_rate=Fraction(frame_rate), idle_ratio=idle_ratio)
    rows = simulate_rows(model, GridPath(np.full(9, float(nominal_hz))), 2.0, 1)
    series = rows.level[:, :, 0].astype(np.float64).ravel()
    c = f0_hz * idle_ratio / frame_rate
    for m in range(round(f0_hz / frame_rate) + 3):
        got = slow_line(series, frame_rate * 240, f0_hz - m * frame_rate) / (110 * 0.5)
        assert got == pytest.approx(abs(np.sinc(c - m)), abs=3e-4), m


@pytest.mark.parametrize("frame_rate", [Fraction(30000, 1001), Fraction(25), Fraction(60000, 1001)])
def test_each_row_is_where_the_shutter_puts_it(frame_rate: Fraction) -> None:
    # T_n + l·T_ro/L + T_e/2, with T_ro = (1 - ρ)/F_r, against the waveform written out.
    model = plain(frame_rate=frame_rate, idle_ratio=0.3).with_effect("exposure", exposure_s=0.003)
    rows = simulate_rows(model, STEADY, 3.0, 1)
    n, row = np.mgrid[: len(rows.level), :240]
    t_s = n / float(frame_rate) + row / 240 * 0.7 / float(frame_rate) + 0.0015
    wave = 110 * (1 + 0.5 * np.sinc(0.3) * np.cos(2 * np.pi * 100 * t_s + 0.4))
    assert rows.level[:, :, 0] == pytest.approx(wave, abs=0.12)  # six times the noise
    assert rows.frame_time_s == pytest.approx(np.arange(len(n)) / float(frame_rate), abs=1e-12)


def test_noise_has_the_size_that_the_sensor_says() -> None:
    sensor = Sensor(white_e=5000.0, read_noise_e=30.0)
    light = Light(flicker_ratio=0.0)
    model = CaptureModel(
        light=light, scene=FLAT, sensor=sensor, shutter=Shutter(rows=120, columns=320)
    )
    level = simulate_rows(model, STEADY, 10.0, 1, strips=4).level
    variance = (110 * 255 / 5000 + (30 * 255 / 5000) ** 2 + 1 / 12) / 80
    assert np.var(level) == pytest.approx(variance, rel=0.02)
    noise = level.astype(np.float64) - 110
    assert abs(np.mean(noise[1:] * noise[:-1])) < 0.02 * variance
    assert abs(np.mean(noise[:, :, 1:] * noise[:, :, :-1])) < 0.02 * variance


def test_without_noise_rows_are_their_means() -> None:
    clean = simulate_rows(plain(), STEADY, 2.0, 1, noise=False).level
    noisy = [simulate_rows(plain(), STEADY, 2.0, 1).level]
    many = CaptureModel(light=PURE, scene=FLAT, shutter=Shutter(rows=240, columns=320))
    noisy += [simulate_rows(many, STEADY, 2.0, seed).level for seed in range(40)]
    assert noisy[0] == pytest.approx(clean, abs=0.12)
    assert np.mean(noisy[1:], axis=0) == pytest.approx(clean, abs=0.09)
    assert np.array_equal(clean, simulate_rows(many, STEADY, 2.0, 9, noise=False).level)


def test_same_seed_same_rows_and_a_longer_clip_begins_with_the_shorter() -> None:
    grid = synthetic_grid(2, 30)
    short, again, long = (simulate_rows(plain(), grid, d, 5).level for d in (4, 4, 11))
    assert np.array_equal(short, again)
    assert np.array_equal(short[:64], long[:64])  # whole blocks
    assert not np.array_equal(short, simulate_rows(plain(), grid, 4, 6).level)


@pytest.mark.parametrize("read_out", ["rows", "columns"])
def test_a_measured_profile_is_filmed_again(read_out: str) -> None:
    shutter = Shutter(rows=64, columns=96, read_out=read_out)
    model = CaptureModel(light=Light(flicker_ratio=0.0), shutter=shutter)
    measured = simulate_rows(model, STEADY, 1.0, 1, strips=3, noise=False).level[0]
    scene = Scene(profile=tuple(map(tuple, measured.tolist())))
    fitted = CaptureModel.from_dict(dataclasses.replace(model, scene=scene).to_dict())
    again = simulate_rows(fitted, STEADY, 1.0, 2, strips=3, noise=False).level
    assert again == pytest.approx(np.broadcast_to(measured, again.shape), abs=1e-4)
    assert scene.level == pytest.approx(110.0, abs=0.5)


@pytest.mark.parametrize(
    ("profile", "says"),
    [
        (((100.0,),) * 63, "isn't 64 lines"),
        (((100.0,),) * 63 + ((100.0, 90.0),), "equally many strips"),
        (((),) * 64, "equally many strips"),
        (((300.0,),) * 64, "between 0 and 255"),
    ],
)
def test_profiles_that_can_t_be(profile: tuple[tuple[float, ...], ...], says: str) -> None:
    with pytest.raises(UsageError, match=f"scene.profile .*{says}"):
        CaptureModel(scene=Scene(profile=profile), shutter=Shutter(rows=64, columns=96)).validate()


def test_strips_average_to_the_row() -> None:
    model = CaptureModel(shutter=Shutter(rows=120, columns=320))
    one, many = (simulate_rows(model, STEADY, 1.0, 1, strips=s).level for s in (1, 5))
    assert many.shape == (30, 120, 5)
    assert many.mean(axis=2) == pytest.approx(one[:, :, 0], abs=0.6)
    assert np.std(many[0, 60]) > 1  # the wall is textured


@pytest.mark.parametrize("read_out", ["columns", "global"])
def test_other_shutters(read_out: str) -> None:
    model = plain(rows=64, columns=96, read_out=read_out, idle_ratio=0.3)
    rows = simulate_rows(model, STEADY, 3.0, 1)
    lines, line_s = (96, 0.7 * 1001 / 30000 / 96) if read_out == "columns" else (64, 0.0)
    assert rows.level.shape == (90, lines, 1)
    n, line = np.mgrid[:90, :lines]
    wave = 110 * (1 + 0.5 * np.cos(2 * np.pi * 100 * (n * 1001 / 30000 + line * line_s) + 0.4))
    assert rows.level[:, :, 0] == pytest.approx(wave, abs=0.3)
    assert rows.truth["read_out_time_s"] == pytest.approx(lines * line_s)
    assert rows.truth["idle_ratio"] == pytest.approx(0.3 if read_out == "columns" else 1.0)
    assert rows.truth["read_out_axis"] == ("columns" if read_out == "columns" else "rows")


def test_progress_ends_with_all_frames() -> None:
    seen: list[int] = []
    rows = simulate_rows(plain(rows=16, columns=16), STEADY, 5.0, 1, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == len(rows.level) == 150


def test_a_clip_longer_than_its_path_is_refused() -> None:
    with pytest.raises(UsageError, match=r"longer than the grid path, which has 5 s left"):
        simulate_rows(plain(), GridPath(np.full(9, 50.0), start_s=4.0), 6.0, 1)


@pytest.mark.parametrize(
    ("duration_s", "seed", "strips", "says"),
    [(0.0, 1, 1, "no frame"), (1.0, -1, 1, "seed"), (1.0, 1, 0, "strips"), (1.0, 1, 999, "strips")],
)
def test_arguments_that_can_t_be_meant(
    duration_s: float, seed: int, strips: int, says: str
) -> None:
    with pytest.raises(UsageError, match=says):
        simulate_rows(plain(), STEADY, duration_s, seed, strips=strips)


@pytest.mark.parametrize("exposure_s", [0.0, 0.0071])  # the latter nearly blots out harmonic 1
def test_lines_of_averaged_rows_are_the_means_of_rows(exposure_s: float) -> None:
    rows = CaptureModel(
        light=Light(lamp="cfl", phase_rad=0.4), scene=FLAT, sensor=QUIET,
        shutter=Shutter(rows=480, columns=320, idle_ratio=0.3, frame_rate=Fraction(25)),
    ).with_effect("exposure", exposure_s=exposure_s)  # fmt: skip
    rows = rows.with_effect("pwm_tone", tone_hz=564.8, depth_ratio=0.01)
    lines = dataclasses.replace(rows, shutter=dataclasses.replace(rows.shutter, rows=120))
    grid = GridPath(np.full(20, 60.0))
    mean = simulate_rows(rows, grid, 3.0, 1, noise=False).level.reshape(75, 120, 4, 1).mean(axis=2)
    made = simulate_rows(lines, grid, 3.0, 1, noise=False, averaged_rows=4).level
    assert made == pytest.approx(mean, abs=2e-4)
