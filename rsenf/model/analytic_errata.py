"""Errata of the paper's line model and tables, and the table entries that each of them changes.

The reason for a wrong entry is found, not listed: each printed entry is compared with the model as
the paper reads it, then with the exact ``M``, then with all lines. Where two successive readings
differ, the change between them is the reason.

Also the paper's figure of the strongest line against the idle period, from model and simulation.
The simulation knows nothing of the lines: a wall without texture under ``|cos|`` light on a steady
grid is captured row by row, the rows are concatenated, and the highest peak of their spectrum is
taken.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from rsenf.model.analytic import RECTIFIED, SpectralLine
from rsenf.model.analytic_tables import (
    AS_PUBLISHED,
    PUBLISHED_TABLES,
    ModelReading,
    PublishedTable,
    Row,
    idle_table,
    printed_table,
)
from rsenf.model.capture_model import CaptureModel
from rsenf.model.grid import FloatArray, GridPath
from rsenf.model.light import Light
from rsenf.model.noise import Sensor, generator
from rsenf.model.row_level import simulate_rows
from rsenf.model.scene import Scene
from rsenf.model.shutter import Shutter

_TABLES = "both idle tables"


@dataclass(frozen=True)
class Difference:
    """A printed entry and the correct one."""

    frame_rate_hz: float
    nominal_hz: float
    published: Row
    right: Row  # unrounded


@dataclass(frozen=True)
class Erratum:
    """An error of the paper, with the entries of the idle tables that it changes."""

    name: str
    where: str  # in the paper
    published: str
    right: str
    entries: tuple[Difference, ...] = ()


def errata() -> tuple[Erratum, ...]:
    """List the known errors of the paper's line model and tables."""
    found: dict[str, list[Difference]] = {}
    for table in PUBLISHED_TABLES:
        for name, difference in _differences(table):
            found.setdefault(name, []).append(difference)
    return tuple(
        dataclasses.replace(erratum, entries=tuple(found.get(erratum.name, ())))
        for erratum in _ERRATA
    )


def _differences(table: PublishedTable) -> Iterator[tuple[str, Difference]]:
    """Yield the errata that a table's entries show, with the correct entry."""
    place = (table.frame_rate_hz, table.nominal_hz)
    turns = 4 * table.nominal_hz / table.frame_rate_hz  # whole where lines of the light coincide
    all_lines = "coinciding_lines" if abs(turns - round(turns)) < 1e-9 else "folded_lines"
    as_published, exact, full = (
        printed_table(*place, reading)
        for reading in (AS_PUBLISHED, ModelReading(folded=False), ModelReading())
    )
    right, rectified = (
        idle_table(*place, reading)
        for reading in (ModelReading(), ModelReading(harmonics=RECTIFIED))
    )
    for n, printed in enumerate(table.entries):
        defined = printed
        if printed.amplitude_ratio is None:
            defined = dataclasses.replace(printed, h2_hz=())
            yield "undefined_second_line", Difference(*place, printed, right[n])
        steps = (defined, as_published[n], exact[n], full[n])
        for name, before, after in zip(
            ("printed_digit", "whole_rows", all_lines), steps[:-1], steps[1:], strict=True
        ):
            if not before.agrees(after):
                yield name, Difference(*place, printed, right[n])
        if _lines(rectified[n].h2_hz) != _lines(right[n].h2_hz):
            yield "second_harmonic", Difference(*place, printed, rectified[n])


def _lines(freq_hz: tuple[float, ...]) -> set[float]:
    return {round(hz, 3) for hz in freq_hz}


_ERRATA = (
    Erratum(
        "amplitude_not_power",
        f"{_TABLES}, P_H1/P_H2",
        "a ratio of powers",
        "It is the ratio of amplitudes: at 29.97 fps and 5 % idle (1 − c)/c = 5.0 with "
        "c = f_0·ρ/F_r; the powers' ratio would be 24.9.",
    ),
    Erratum(
        "undefined_second_line",
        f"{_TABLES}, wherever the ratio is infinite",
        "a second line of 0, 75 or 100 Hz",
        "c is whole there, so harmonic 1 makes one line only: there is no second one.",
    ),
    Erratum(
        "printed_digit",
        "idle table, 29.97 fps, 35 % and 55 %",
        "5.0 and 5.0",
        "The paper's own model, with M = round(L/(1 − ρ)) and L = 720, gives 4.9 and 5.1. With the "
        "exact M it gives 4.96 and 5.07: the print is right at 35 % and 0.1 low at 55 %.",
    ),
    Erratum(
        "whole_rows",
        "idle table, 29.97 fps, 30 % and 35 %",
        "505.6 at 30 %",
        "998, against the 40 Hz line: 505.6 is an artefact of rounding M to whole rows, for which "
        "nothing in a camera asks. Near a zero of the second line small shifts of ρ or F_r count: "
        "with F_r = 30000/1001 in place of 29.97 the exact ratio is 999.",
    ),
    Erratum(
        "folded_lines",
        "Eq. 20 (Eq_S2), m < f_0/F_r; idle table, 29.97 fps, 90 % and 95 %",
        "H_2 at 40 Hz, ratios 334.0 and 6.9",
        "Lines below 0 Hz are seen at |f_0 − m·F_r|. The second line is at 19.9 Hz, its ratio 332 "
        "at 90 % and 4.9 at 95 %.",
    ),
    Erratum(
        "coinciding_lines",
        "idle table and model at 25 fps; every frame rate that divides 2·f_0, as 30 fps at 60 Hz",
        "one ratio for each idle period",
        "The lines f_0 − m·F_r and −(f_0 − (8 − m)·F_r) are at the same frequency and add as "
        "complex numbers, and the line of m = 4 is lost in the steady light. The ratio depends on "
        "the light's phase: 3.5 to 4.6 at 20 % (printed 4.0), 2.1 to 4.1 at 95 % (printed 2.2). "
        "The table gives the ratio of root mean squares over all phases, and the range.",
    ),
    Erratum(
        "second_harmonic",
        "the text before the section on idle-period estimation; both idle tables",
        "the two strongest lines always come from harmonic 1",
        "Not for |cos| light, the paper's own, where c is nearly whole: H_2 then belongs to "
        "harmonic 2, which is a fifth of harmonic 1, so that the ratio is 5.0.",
    ),
    Erratum(
        "attenuation",
        "Eq. 7 (Fm), the figures of the model, abstract and conclusion",
        "the longer the idle period, the weaker the captured line",
        "F_m carries 1/M, but Eq. 6 also squeezes the frequency axis by L/M, which raises a line "
        "by M/L. In the row series the strongest line has the amplitude |sinc(c − m)|: between "
        "0.64 and 1 at any idle period, unless it is lost at 0 Hz.",
    ),
    Erratum(
        "vertical_phase",
        "Eq. 24, the idle period from the vertical phase (second use of the label Eq_read_out)",
        "100 − (f_I/F_r)·(100/N_c)",
        "100·(1 − N_c·F_r/f_I): a frame period holds f_I/F_r cycles, and N_c of them fall in the "
        "read-out. The printed formula is negative for every idle period above 0.",
    ),
    Erratum(
        "exposure",
        "the whole model",
        "not considered",
        "An exposure T_e multiplies harmonic k by sinc(k·f_0·T_e). It cancels out of ratios within "
        "harmonic 1; 1/200 s (at 100 Hz) removes harmonic 2, 1/100 s removes everything.",
    ),
)


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
class LinePeak:
    """A peak of a spectrum; its amplitude is relative to harmonic 1 of the light."""

    freq_hz: float
    amplitude: float


def simulated_peak(
    frame_rate: Fraction, nominal_hz: float, idle_ratio: float, phase_rad: float, seed: int
) -> LinePeak:
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
    return LinePeak(peak.freq_hz, float(peak.amplitude / first))


def strongest_peak(series: FloatArray, sample_rate_hz: float) -> LinePeak:
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
    return LinePeak(float((at + shift) * sample_rate_hz / size), float(2 * height / window.sum()))


@dataclass(frozen=True)
class IdlePoint:
    """The strongest line at one idle period.

    ``model`` is the strongest by rms over the light's phase, ``model_there`` at the phase of the
    simulation. They differ only where lines coincide.
    """

    idle_percent: int
    model: SpectralLine
    phase_rad: float
    model_there: LinePeak
    simulated: LinePeak


def strongest_against_idle(
    frame_rate: Fraction,
    nominal_hz: float,
    reading: ModelReading,
    idle_percents: Iterable[int],
    seed: int = 1,
) -> Iterator[IdlePoint]:
    """Find the strongest line at each idle period, in the model and in a simulation.

    Parameters
    ----------
    frame_rate : Fraction
        ``F_r``.
    nominal_hz : float
        Frequency of the grid.
    reading : ModelReading
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
        yield IdlePoint(
            idle,
            found[0],
            phase_rad,
            LinePeak(there.freq_hz, float(there.at_phase(phase_rad))),
            simulated_peak(frame_rate, nominal_hz, idle / 100, phase_rad, seed),
        )
