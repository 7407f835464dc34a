"""The line model against the time-domain simulation, at every idle value of both tables."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from rsenf.model import CaptureModel, GridPath, Light, Scene, Sensor, Shutter, simulate_rows
from rsenf.model.analytic import COSINE, RECTIFIED, lines
from rsenf.model.analytic_errata import CASES, DURATION_S, strongest_against_idle, strongest_peak
from rsenf.model.analytic_tables import ModelReading, strongest

# So wide a picture has so little row noise that lines 2e-6 of the strongest apart keep their order.
ROWS, COLUMNS, F0_HZ = 240, 4096, 100.0
LIGHTS = {"tone": COSINE, "ideal": RECTIFIED}
IDLE_PERCENTS = range(0, 100, 5)


def row_series(
    frame_rate: Fraction, idle_percent: int, duration_s: float, lamp: str, phase_rad: float
) -> tuple[np.ndarray, float]:
    """Concatenated rows relative to harmonic 1 of the light, and the noise of a row."""
    light = Light(lamp=lamp, flicker_ratio=0.5, phase_rad=phase_rad)
    scene, sensor = (
        Scene(texture_ratio=0.0, vignetting_ratio=0.0), Sensor(white_e=1e6, read_noise_e=0.0),
    )  # fmt: skip
    model = CaptureModel(
        light=light,
        scene=scene,
        sensor=sensor,
        shutter=Shutter(
            frame_rate=frame_rate, rows=ROWS, columns=COLUMNS, idle_ratio=idle_percent / 100
        ),
    )
    grid = GridPath(np.full(math.ceil(duration_s) + 2, F0_HZ / 2))
    level = simulate_rows(model, grid, duration_s, 1).level
    first = scene.mean_level * 0.5
    noise = math.sqrt((sensor.variance(scene.mean_level) + 1 / 12) / COLUMNS) / first
    return level.astype(np.float64).ravel() / first, noise


def slow_line(series: np.ndarray, sample_rate_hz: float, freq_hz: float) -> float:
    """Amplitude of one line by the sum that defines it."""
    index = np.arange(series.size)
    turns = freq_hz / sample_rate_hz * index
    return float(2 * abs(np.mean(series * np.exp(-2j * np.pi * (turns % 1.0)))))


def highest_two(series: np.ndarray, sample_rate_hz: float) -> list[float]:
    """Frequencies of the two highest samples of the spectrum beside 0 Hz."""
    size = np.abs(np.fft.rfft(series))
    size[0] = 0
    return (np.argsort(size)[:-3:-1] * sample_rate_hz / series.size).tolist()


@pytest.mark.parametrize("idle_percent", IDLE_PERCENTS)
@pytest.mark.parametrize("lamp", LIGHTS)
def test_at_29_97_fps(idle_percent: int, lamp: str) -> None:
    # In 2997 frames every line turns a whole number of times: none leaks into another.
    frame_rate, duration_s = Fraction("29.97"), 100.0
    series, noise = row_series(frame_rate, idle_percent, duration_s, lamp, 0.7)
    rate_hz = float(frame_rate) * ROWS
    top = strongest(
        lines(float(frame_rate), F0_HZ, idle_percent / 100, rows=ROWS, harmonics=LIGHTS[lamp])
    )
    seen_hz = highest_two(series, rate_hz)
    assert seen_hz[0] == pytest.approx(top.first[0].freq_hz, abs=1 / duration_s)
    size = slow_line(series, rate_hz, top.first[0].freq_hz)
    assert size == pytest.approx(top.first[0].amplitude, rel=1e-3)
    line_noise = noise * math.sqrt(2 / series.size)
    if top.amplitude_ratio is None:
        assert slow_line(series, rate_hz, seen_hz[1]) < 8 * line_noise
        return
    assert top.second[0].amplitude > 20 * line_noise
    assert seen_hz[1] == pytest.approx(top.second[0].freq_hz, abs=1 / duration_s)
    ratio = size / slow_line(series, rate_hz, top.second[0].freq_hz)
    assert ratio == pytest.approx(top.amplitude_ratio, rel=0.02)


@pytest.mark.parametrize("idle_percent", IDLE_PERCENTS)
@pytest.mark.parametrize("lamp", LIGHTS)
@pytest.mark.parametrize("phase_rad", [-2.0, 0.0, 0.9])
def test_at_25_fps_at_the_light_s_phase(idle_percent: int, lamp: str, phase_rad: float) -> None:
    frame_rate, duration_s = Fraction(25), 4.0
    series, noise = row_series(frame_rate, idle_percent, duration_s, lamp, phase_rad)
    rate_hz = float(frame_rate) * ROWS
    found = lines(25.0, F0_HZ, idle_percent / 100, rows=ROWS, harmonics=LIGHTS[lamp])
    there = sorted(found, key=lambda line: -line.at_phase(phase_rad))[:2]
    seen_hz = highest_two(series, rate_hz)
    assert seen_hz[0] == pytest.approx(there[0].freq_hz, abs=1 / duration_s)
    line_noise = noise * math.sqrt(2 / series.size)
    top = strongest(found)
    if top.amplitude_ratio is None:
        assert slow_line(series, rate_hz, seen_hz[1]) < 8 * line_noise
        return
    assert seen_hz[1] == pytest.approx(there[1].freq_hz, abs=1 / duration_s)
    # The table's two lines: equal to the model at this phase, and within the range of all phases.
    one, two = top.first[0], top.second[0]
    sizes = [slow_line(series, rate_hz, line.freq_hz) for line in (one, two)]
    ratio = sizes[0] / sizes[1]
    assert ratio == pytest.approx(one.at_phase(phase_rad) / two.at_phase(phase_rad), rel=0.02)
    assert top.ratio_range is not None
    assert 0.98 * top.ratio_range[0] < ratio < 1.02 * top.ratio_range[1]


def test_the_strongest_line_does_not_fade_with_the_idle_period() -> None:
    # The erratum "attenuation": at 60 % idle, 29.97 fps, the 40 Hz line is as high as the light's.
    rate_hz = 29.97 * ROWS
    sizes = [
        slow_line(row_series(Fraction("29.97"), idle, 100.0, "tone", 0.7)[0], rate_hz, hz)
        for idle, hz in ((0, 100.0), (60, 40.06))
    ]
    assert sizes == pytest.approx([1.0, 1.0], abs=1e-3)


@pytest.mark.parametrize(("frame_rate", "nominal_hz"), CASES)
def test_the_figure(frame_rate: Fraction, nominal_hz: float) -> None:
    reading = ModelReading(harmonics=RECTIFIED, rows=120)
    points = list(strongest_against_idle(frame_rate, nominal_hz, reading, range(0, 96, 5)))
    assert [point.idle_percent for point in points] == list(range(0, 96, 5))
    for point in points:
        assert point.simulated.freq_hz == pytest.approx(point.model_there.freq_hz, abs=0.01)
        assert point.simulated.amplitude == pytest.approx(point.model_there.amplitude, rel=0.005)
        low, high = point.model.amplitude_range()
        if point.model.freq_hz == point.model_there.freq_hz:
            assert low * 0.995 <= point.simulated.amplitude <= high * 1.005
    spread = [point.phase_rad for point in points]
    assert min(spread) < -1
    assert max(spread) > 1


def test_a_peak_between_the_samples_of_the_spectrum() -> None:
    t_s = np.arange(int(DURATION_S * 900)) / 900
    for hz in (7.0, 33.333, 61.4142):
        peak = strongest_peak(5 + 0.3 * np.cos(2 * np.pi * hz * t_s + 1), 900.0)
        assert peak.freq_hz == pytest.approx(hz, abs=1e-4)
        assert peak.amplitude == pytest.approx(0.3, rel=1e-3)
