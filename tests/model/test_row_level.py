from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.model import (
    CaptureModel,
    Delivery,
    GridPath,
    Light,
    Scene,
    Sensor,
    Shutter,
    simulate_rows,
    synthetic_grid,
)

PURE = Light(flicker_ratio=0.5, harmonic_ratios=(), phase_rad=0.4)
FLAT = Scene(texture_ratio=0.0, vignetting_ratio=0.0)
QUIET = Sensor(white_e=1e6, read_noise_e=0.0)
STEADY = GridPath(np.full(20, 50.0))


def plain(**shutter: object) -> CaptureModel:
    base = {"rows": 240, "columns": 320, "exposure_s": 0.0, **shutter}
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
    # SCIENCE, item 2: the line at f0 - m·Fr has the amplitude |sinc(c - m)|, c = f0·ρ/Fr.
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
    model = plain(frame_rate=frame_rate, idle_ratio=0.3, exposure_s=0.003)
    rows = simulate_rows(model, STEADY, 3.0, 1)
    n, row = np.mgrid[: len(rows.level), :240]
    t_s = n / float(frame_rate) + row / 240 * 0.7 / float(frame_rate) + 0.0015
    wave = 110 * (1 + 0.5 * np.sinc(0.3) * np.cos(2 * np.pi * 100 * t_s + 0.4))
    assert rows.level[:, :, 0] == pytest.approx(wave, abs=0.12)  # six times the noise
    assert rows.frame_time_s == pytest.approx(np.arange(len(n)) / float(frame_rate), abs=1e-12)


@pytest.mark.parametrize("clock_ppm", [-300.0, 300.0])
def test_a_fast_clock_makes_the_enf_read_low(clock_ppm: float) -> None:
    rows = simulate_rows(plain(clock_ppm=clock_ppm), STEADY, 10.0, 1)
    t_s = rows.frame_time_s[:, None] + np.arange(240) / 240 * rows.truth["read_out_time_s"]
    flicker = rows.level[:, :, 0] - rows.level.mean()
    phase = np.unwrap(np.angle(np.mean(flicker * np.exp(-2j * np.pi * 100 * t_s), axis=1)))
    slope = np.polyfit(rows.frame_time_s, phase, 1)[0]
    seen_hz = (100 + slope / (2 * np.pi)) / 2
    assert seen_hz == pytest.approx(50 / (1 + clock_ppm * 1e-6), abs=2e-4)
    assert (seen_hz < 50) == (clock_ppm > 0)


def test_noise_has_the_size_that_the_sensor_says() -> None:
    sensor = Sensor(white_e=5000.0, read_noise_e=30.0)
    light = Light(flicker_ratio=0.0, harmonic_ratios=())
    model = CaptureModel(
        light=light, scene=FLAT, sensor=sensor, shutter=Shutter(rows=120, columns=320)
    )
    level = simulate_rows(model, STEADY, 10.0, 1, strips=4).level
    variance = (110 * 255 / 5000 + (30 * 255 / 5000) ** 2 + 1 / 12) / 80
    assert np.var(level) == pytest.approx(variance, rel=0.02)
    noise = level.astype(np.float64) - 110
    assert abs(np.mean(noise[1:] * noise[:-1])) < 0.02 * variance
    assert abs(np.mean(noise[:, :, 1:] * noise[:, :, :-1])) < 0.02 * variance


def test_same_seed_same_rows_and_a_longer_clip_begins_with_the_shorter() -> None:
    grid = synthetic_grid(2, 30)
    short, again, long = (simulate_rows(plain(), grid, d, 5).level for d in (4, 4, 11))
    assert np.array_equal(short, again)
    assert np.array_equal(short[:64], long[:64])  # whole blocks
    assert not np.array_equal(short, simulate_rows(plain(), grid, 4, 6).level)


def test_strips_average_to_the_row() -> None:
    model = CaptureModel(shutter=Shutter(rows=120, columns=320))
    one, many = (simulate_rows(model, STEADY, 1.0, 1, strips=s).level for s in (1, 5))
    assert many.shape == (30, 120, 5)
    assert many.mean(axis=2) == pytest.approx(one[:, :, 0], abs=0.6)
    assert np.std(many[0, 60]) > 1  # the wall is textured


@pytest.mark.parametrize("retimed", [False, True])
def test_dropped_frames_leave_a_hole_or_are_hidden(retimed: bool) -> None:
    delivery = Delivery(drops_per_min=120.0, retimed=retimed)
    model = CaptureModel(
        light=PURE, scene=FLAT, sensor=QUIET, delivery=delivery,
        shutter=Shutter(rows=64, columns=320, exposure_s=0.0),
    )  # fmt: skip
    rows = simulate_rows(model, STEADY, 10.0, 3)
    dropped = rows.truth["dropped_frames"]
    assert len(dropped) == pytest.approx(20, abs=12)
    assert len(rows.level) == rows.truth["frames"] == 300 - len(dropped)
    kept = np.setdiff1d(np.arange(300), dropped)
    whole = simulate_rows(
        CaptureModel(light=PURE, scene=FLAT, sensor=QUIET, shutter=model.shutter), STEADY, 10.0, 3
    )
    assert rows.level == pytest.approx(whole.level[kept], abs=0.2)
    expected = np.arange(len(kept)) if retimed else kept
    assert rows.frame_time_s == pytest.approx(expected * 1001 / 30000, abs=1e-12)


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
