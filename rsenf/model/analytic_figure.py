"""The paper's figure of the strongest line against the idle period, from model and simulation.

The simulation knows nothing of the lines: a wall without texture under ``|cos|`` light on a steady
grid is captured row by row, the rows are concatenated, and the highest peak of their spectrum is
taken.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from rsenf.model.analytic import SpectralLine
from rsenf.model.analytic_tables import Reading
from rsenf.model.capture_model import CaptureModel
from rsenf.model.grid import FloatArray, GridPath
from rsenf.model.light import Light
from rsenf.model.noise import Sensor, generator
from rsenf.model.row_level import simulate_rows
from rsenf.model.scene import Scene
from rsenf.model.shutter import Shutter

ROWS, COLUMNS = 120, 64
DURATION_S = 20.0
_PADDING = 4  # spectrum samples per 1/duration
_LAMP = "ideal"
# Frame rate as printed, and grid. The paper shows the first three and 23.976 fps in its examples.
CASES = (
    (Fraction(30), 50.0),
    (Fraction(30), 60.0),
    (Fraction(25), 50.0),
    (Fraction("23.976"), 50.0),
)


@dataclass(frozen=True)
class Peak:
    """A peak of a spectrum; its amplitude is relative to harmonic 1 of the light."""

    freq_hz: float
    amplitude: float


def simulated_peak(
    frame_rate: Fraction, nominal_hz: float, idle_ratio: float, phase_rad: float, seed: int
) -> Peak:
    """Simulate 20 s under ``|cos|`` light and measure the strongest line.

    Parameters
    ----------
    frame_rate : Fraction
        ``F_r``.
    nominal_hz : float
        Frequency of the grid.
    idle_ratio : float
        ``ρ``.
    phase_rad : float
        Phase of the light's harmonic 1 when the first frame begins.
    seed : int
        Of the noise.
    """
    light = Light(lamp=_LAMP, phase_rad=phase_rad)
    scene = Scene(texture_ratio=0.0, vignetting_ratio=0.0)
    model = CaptureModel(
        light=light,
        scene=scene,
        sensor=Sensor(white_e=1e6, read_noise_e=0.0),
        shutter=Shutter(frame_rate=frame_rate, rows=ROWS, columns=COLUMNS, idle_ratio=idle_ratio),
    )
    grid = GridPath(np.full(int(DURATION_S) + 2, nominal_hz))
    series = simulate_rows(model, grid, DURATION_S, seed).level.astype(np.float64).ravel()
    peak = strongest_peak(series, float(frame_rate) * ROWS)
    first = scene.mean_level * abs(light.series(2 * nominal_hz)[0])
    return Peak(peak.freq_hz, float(peak.amplitude / first))


def strongest_peak(series: FloatArray, sample_rate_hz: float) -> Peak:
    """Find the highest peak of a series' spectrum apart from its mean, amplitude in its own unit.

    A Hann window separates lines; a parabola through the logarithms of the three highest samples
    gives frequency and height to about a thousandth.
    """
    window = np.hanning(series.size)
    size = 1 << (_PADDING * series.size - 1).bit_length()
    spectrum = np.abs(np.fft.rfft((series - series.mean()) * window, size))
    bins = size / series.size  # spectrum samples per 1/duration
    spectrum[: int(3 * bins)] = 0.0  # leakage of the mean, which would hide so low a line
    at = int(np.argmax(spectrum[:-1]))
    left, top, right = np.log(spectrum[at - 1 : at + 2])
    shift = 0.5 * (left - right) / (left - 2 * top + right)
    height = np.exp(top - 0.25 * (left - right) * shift)
    return Peak(float((at + shift) * sample_rate_hz / size), float(2 * height / window.sum()))


@dataclass(frozen=True)
class Point:
    """The strongest line at one idle period.

    ``model`` is the strongest by rms over the light's phase, ``model_there`` at the phase of the
    simulation. They differ only where lines coincide.
    """

    idle_percent: int
    model: SpectralLine
    phase_rad: float
    model_there: Peak
    simulated: Peak


def strongest_against_idle(
    frame_rate: Fraction,
    nominal_hz: float,
    reading: Reading,
    idle_percents: Iterable[int],
    seed: int = 1,
) -> Iterator[Point]:
    """Find the strongest line at each idle period, in the model and in a simulation.

    Parameters
    ----------
    frame_rate : Fraction
        ``F_r``.
    nominal_hz : float
        Frequency of the grid.
    reading : Reading
        How the model is read.
    idle_percents : iterable of int
        Idle periods; each is simulated with a random phase of the light.
    seed : int, optional
        Of phases and noise.
    """
    for idle in idle_percents:
        phase_rad = float(generator(seed, "phase of a point", idle).uniform(-math.pi, math.pi))
        found = reading.lines(float(frame_rate), nominal_hz, idle / 100)
        there = max(found, key=lambda line: float(line.at_phase(phase_rad)))
        yield Point(
            idle,
            found[0],
            phase_rad,
            Peak(there.freq_hz, float(there.at_phase(phase_rad))),
            simulated_peak(frame_rate, nominal_hz, idle / 100, phase_rad, seed),
        )
