from __future__ import annotations

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.model import GridPath, Light
from rsenf.model.lamp import LAMPS, rectified_cosine
from rsenf.model.light import relative_level


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
    got = relative_level(light.series(), 0.7, grid, rows_s, exposure_s)
    slow = [[slow_level(light, 0.7, grid, t, exposure_s) for t in row] for row in rows_s.tolist()]
    # f0 is taken once a frame: within one it moves by less than a millihertz.
    assert got == pytest.approx(np.array(slow), abs=5e-6)
    assert got.dtype == np.float32


def test_exposure_multiplies_each_harmonic_by_a_sinc() -> None:
    grid = GridPath(np.full(10, 50.0))
    rows_s = np.arange(4000)[None] / 4000  # one second of one endless frame
    series = Light(lamp="ideal").series()
    lines = np.fft.rfft(relative_level(series, 0.0, grid, rows_s, 1 / 250)[0]) / 2000
    for k in range(1, 5):
        expected = abs(series[k - 1] * np.sinc(k * 100 / 250))
        assert abs(lines[100 * k]) == pytest.approx(expected, abs=1e-6)


def test_the_anti_flicker_exposures() -> None:
    grid = GridPath(np.full(10, 50.0))
    rows_s = np.arange(4000)[None] / 4000
    series = Light(lamp="ideal").series()
    lines = np.abs(np.fft.rfft(relative_level(series, 0.0, grid, rows_s, 1 / 200)[0]))
    assert lines[200] < 1e-5 * lines[100]
    still = relative_level(series, 0.0, grid, rows_s, 1 / 100)
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
    assert -1 / LAMPS["ideal"].harmonic_ratios[0] == pytest.approx(5.0)


def test_daylight_takes_its_share_of_the_flicker() -> None:
    full = Light(lamp="led").series()
    assert Light(lamp="led", daylight_ratio=0.25).series() == pytest.approx(0.75 * full)
    assert full[0] == pytest.approx(0.10)


def test_own_harmonics_replace_the_lamp_s() -> None:
    light = Light(flicker_ratio=0.3, harmonic_ratios=(0.5,))
    assert light.series() == pytest.approx([0.3, 0.15])
    assert Light(harmonic_ratios=()).series() == pytest.approx([0.1])


def test_phases_without_harmonics_are_refused() -> None:
    with pytest.raises(UsageError, match="harmonic_phases_rad has 2 phases, not 1"):
        Light(harmonic_ratios=(0.5,), harmonic_phases_rad=(0.1, 0.2)).series()


def test_the_phase_is_drawn_from_the_seed_or_given() -> None:
    assert Light().drawn_phase_rad(3) == Light().drawn_phase_rad(3)
    assert Light().drawn_phase_rad(3) != Light().drawn_phase_rad(4)
    assert Light(phase_rad=1.25).drawn_phase_rad(3) == 1.25
