"""The grid's frequency behind the lamp: measured data, or a synthetic path drawn from a seed.

Data for fitting constants and data for testing them are disjoint.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray
from rsenf.model import GridPath, synthetic_grid
from rsenf.reference import read_reference

# Files of a folder of measured data: a day and nine days of the continental European grid, 1 s a
# sample, and 21 days of a US grid, 2 s a sample.
CE_2022 = "grid_ce_2022-09-17_1s.csv.gz"
CE_2024 = "grid_ce_2024-08-13_to_21_gappy_1s.csv.gz"
US_2022 = "grid_us_60hz_2022-07_2s.npz"
MEASURED = {50.0: CE_2022, 60.0: US_2022}  # by nominal frequency, Hz
MARGIN_S = 4.0


@dataclass(frozen=True, eq=False)
class Measured:
    """Days of a grid's frequency: ``freq_hz`` has shape (days, samples)."""

    name: str
    freq_hz: FloatArray
    step_s: float


def grid_for(
    folder: Path | None, nominal_hz: float, duration_s: float, rng: np.random.Generator
) -> tuple[GridPath, str]:
    """Return a grid's frequency from a random time on, and the name of the grid.

    Parameters
    ----------
    folder : Path or None
        With the files of :data:`MEASURED`; without it, or without its file, the path is synthetic.
    nominal_hz : float
    duration_s : float
        Of the clip.
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
    reference = read_reference(path)
    return Measured(reference.grid, reference.freq_hz[None], reference.step_s)


DAY_S = 86400
FIT, TEST = "fit", "test"


@dataclass(frozen=True, eq=False)
class Stretch:
    """Consecutive samples of a grid; NaN in gaps."""

    name: str
    nominal_hz: float
    step_s: float
    freq_hz: FloatArray


@functools.lru_cache(maxsize=2)
def stretches(folder: Path, part: str) -> tuple[Stretch, ...]:
    """Return the measured data of a part.

    ``fit``: the continental European grid of 2024 before 18 August, and the first eleven US days.
    ``test``: a day of the European grid in 2022, and the other ten US days.

    Parameters
    ----------
    folder : Path
        Of the measured data.
    part : {'fit', 'test'}

    Raises
    ------
    UsageError
        When the folder doesn't exist.
    """
    if not folder.is_dir():
        raise UsageError(f"no measured grids in {folder}", "name their folder with --grids")
    measured = _read(folder / US_2022)
    us = [Stretch(f"us-{i}", 60.0, measured.step_s, day) for i, day in enumerate(measured.freq_hz)]
    if part == TEST:
        day = read_reference(folder / CE_2022).freq_hz
        return (Stretch("ce-2022", 50.0, 1.0, day), *us[11:])
    week = read_reference(folder / CE_2024).freq_hz
    # From 13 August 23:07:33 UTC on; the first 2.5 days are mostly gaps.
    begin, end = int(2.5 * DAY_S), 4 * DAY_S
    return (Stretch("ce-2024", 50.0, 1.0, week[begin:end]), *us[:11])
