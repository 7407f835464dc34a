"""The grid's frequency behind the lamp: measured where there is data, else drawn from a seed."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray
from rsenf.model import GridPath, synthetic_grid

# Files of a folder of measured data, by the nominal frequency of their grid.
MEASURED = {50.0: "grid_ce_2022-09-17_1s.csv.gz", 60.0: "grid_us_60hz_2022-07_2s.npz"}
MARGIN_S = 4.0


@dataclass(frozen=True, eq=False)
class Measured:
    """Days of a grid's frequency: (days, samples), Hz."""

    name: str
    freq_hz: FloatArray
    step_s: float


def grid_for(
    folder: Path | None, nominal_hz: float, duration_s: float, rng: np.random.Generator
) -> tuple[GridPath, str]:
    """Return a stretch of a grid that begins at a random time, and what grid it is.

    Parameters
    ----------
    folder : Path or None
        With the files of :data:`MEASURED`; without one, or without its file, a path is drawn.
    nominal_hz : float
    duration_s : float
    rng : numpy.random.Generator

    Raises
    ------
    UsageError
        When a day of the data is shorter than the clip.
    """
    path = folder / MEASURED[nominal_hz] if folder else None
    if path is None or not path.is_file():
        seed = int(rng.integers(2**31))
        return synthetic_grid(seed, duration_s + MARGIN_S, nominal_hz=nominal_hz), "synthetic"
    measured = _read(path)
    latest_s = measured.freq_hz.shape[1] * measured.step_s - duration_s - MARGIN_S
    if latest_s <= 0:
        raise UsageError(f"{path} is too short for clips of {duration_s:g} s")
    day = measured.freq_hz[int(rng.integers(len(measured.freq_hz)))]
    start_s = float(rng.uniform(0, latest_s))
    return GridPath(day, measured.step_s, start_s, nominal_hz), measured.name


@functools.cache
def _read(path: Path) -> Measured:
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as held:
            freq_hz = np.asarray(held["frequency"], np.float64)
            return Measured(path.stem, freq_hz, float(held["step_s"]))
    from rsenf.reference import read_reference

    reference = read_reference(path)
    return Measured(reference.grid, reference.freq_hz[None], reference.step_s)
