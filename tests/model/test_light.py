from __future__ import annotations

import numpy as np
import pytest

from rsenf.model import GridPath, Light
from rsenf.model.light import LAMPS, Aperture, rectified_cosine, relative_level


def slow_level(light: Light, phase_rad: float, grid: GridPath, t_s: float, exposure_s: float):
    """Mean of the waveform over an exposure, by brute force."""
    series = light.series()
    times = t_s + (np.arange(4000) + 0.5) / 4000 * exposure_s
    angle = 4 * np.pi * grid.cycles(times) + phase_rad
    wave = 1 + sum(np.real(a * np.exp(1j * (k + 1) * angle)) for k, a in enumerate(series.tolist()))
    return float(np.mean(wave))


@pytest.mark.parametrize("lamp", list(LAMPS))
@pytest.mark.parametrize("exposure_s", [0.0, 0.002, 0.005, 0.010, 0.020])
def test_exposure_is_the_mean_of_the_waveform(lamp: str, exposure_s: float) -> None:
    light = Light(lamp=lamp, daylight_ratio=0.2)
    grid = GridPath([50.03, 50.02, 50.025, 50.012])
    rows_s = np.array([[0.0, 0.003, 0.007], [1.7, 1.7031, 1.7077], [3.2, 3.21, 3.222]])
    got = relative_level(light.series(), 0.7, grid, rows_s, Aperture(exposure_s))
    slow = [[slow_level(light, 0.7, grid, t, exposure_s) for t in row] for row in rows_s.tolist()]
    # f0 is taken once a frame: within one it moves by less than a millihertz.
    assert got == pytest.approx(np.array(slow), abs=5e-6)
    assert got.dtype == np.float32


def test_exposure_multiplies_each_harmonic_by_a_sinc() -> None:
    grid = GridPath(np.full(10, 50.0))
    rows_s = np.arange(4000)[None] / 4000  # one second of one endless frame
    series = Light(lamp="ideal").series()
    lines = np.fft.rfft(relative_level(series, 0.0, grid, rows_s, Aperture(1 / 250))[0]) / 2000
    for k in range(1, 5):
        expected = abs(series[k - 1] * np.sinc(k * 100 / 250))
        assert abs(lines[100 * k]) == pytest.approx(expected, abs=1e-6)


def test_the_anti_flicker_exposures() -> None:
    grid = GridPath(np.full(10, 50.0))
    rows_s = np.arange(4000)[None] / 4000
    series = Light(lamp="ideal").series()
    lines = np.abs(np.fft.rfft(relative_level(series, 0.0, grid, rows_s, Aperture(1 / 200))[0]))
    assert lines[200] < 1e-5 * lines[100]
    still = relative_level(series, 0.0, grid, rows_s, Aperture(1 / 100))
    assert np.ptp(still) < 1e-6


def test_the_ideal_lamp_is_a_rectified_cosine() -> None:
    phase = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    lamp = rectified_cosine(200)
    ratios = np.array([1.0, *lamp.harmonic_ratios])
    light = 1 + lamp.flicker_ratio * sum(
        a * np.cos((k + 1) * phase) for k, a in enumerate(ratios.tolist())
    )
    assert light == pytest.approx(np.abs(np.cos(phase / 2)) * np.pi / 2, abs=4e-3)
    # The amplitude ratio of 5 that the second harmonic of |cos| light sets.
    assert -1 / LAMPS["ideal"](100.0).harmonic_ratios[0] == pytest.approx(5.0)


def test_daylight_takes_its_share_of_the_flicker() -> None:
    full = Light(lamp="led").series()
    assert Light(lamp="led", daylight_ratio=0.25).series() == pytest.approx(0.75 * full)
    assert full[0] == pytest.approx(0.10)


def test_a_filament_lags_behind_its_power() -> None:
    # The heat balance of a wire, stepped in time: C·dT/dt = power − losses, light as T to the 2.1.
    for f0_hz, time_constant_s, lamp in ((100.0, 0.033, "incandescent"), (120.0, 0.042, "halogen")):
        step_s = 1e-5
        t_s = np.arange(0, 1.0, step_s)
        power = 1 + np.cos(2 * np.pi * f0_hz * t_s)
        heat, light = 1.0, np.empty(t_s.size)
        for k, p in enumerate(power.tolist()):
            heat += (p - heat) * step_s / time_constant_s
            light[k] = heat**2.1
        whole = light[t_s.size // 2 :]  # 50 or 60 cycles, settled
        lines = np.abs(np.fft.rfft(whole)) / whole.size
        first = round(f0_hz / 2)
        got = Light(lamp=lamp).series(f0_hz)
        assert abs(got[0]) == pytest.approx(2 * lines[first] / lines[0], rel=0.01)
        assert abs(got[1]) == pytest.approx(2 * lines[2 * first] / lines[0], rel=0.02)


def test_a_60_hz_filament_flickers_less() -> None:
    at_50, at_60 = (abs(Light(lamp="halogen").series(f0)[0]) for f0 in (100.0, 120.0))
    assert at_60 / at_50 == pytest.approx(100 / 120, rel=0.01)


def test_lamps_that_are_given_as_curves() -> None:
    # Rebuilt from its series, a curve is itself as far as eight harmonics go; the crest is at 0.
    phase = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    for lamp, curve in (
        ("sodium", 0.08 + np.abs(np.cos(phase / 2)) ** 1.5),
        ("led_direct", np.maximum(np.abs(np.cos(phase / 2)) - 0.3, 0)),
    ):
        series = Light(lamp=lamp).series()
        light = 1 + sum(
            np.real(a * np.exp(1j * (k + 1) * phase)) for k, a in enumerate(series.tolist())
        )
        assert light == pytest.approx(curve / curve.mean(), abs=0.06)
    saw = LAMPS["led_capacitor"](100.0)
    assert 0.03 < saw.flicker_ratio < 0.06
    assert saw.harmonic_ratios[0] > 0.3


def test_the_phase_is_drawn_from_the_seed_or_given() -> None:
    assert Light().drawn_phase_rad(3) == Light().drawn_phase_rad(3)
    assert Light().drawn_phase_rad(3) != Light().drawn_phase_rad(4)
    assert Light(phase_rad=1.25).drawn_phase_rad(3) == 1.25
