"""The paper's figure of the strongest line against the idle period, from model and simulation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction

from rsenf.model.analytic import SpectralLine
from rsenf.model.analytic_simulation import Peak, simulated_peak
from rsenf.model.analytic_tables import Reading
from rsenf.model.seeds import generator

# Frame rate as printed, and grid. The paper shows the first three and 23.976 fps in its examples.
CASES = (
    (Fraction(30), 50.0),
    (Fraction(30), 60.0),
    (Fraction(25), 50.0),
    (Fraction("23.976"), 50.0),
)


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
