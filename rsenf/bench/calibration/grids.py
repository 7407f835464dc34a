"""Which stretches of measured grids calibrate, and which only test: no second is in both."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray
from rsenf.reference import read_reference

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
    """Return the stretches of a part.

    The continental grid of 2024 before 18 August and the first eleven days of the US one calibrate;
    a day of the continental grid two years earlier and the other ten US days test.

    Parameters
    ----------
    folder : Path
        Of the measured data.
    part : {'fit', 'test'}

    Raises
    ------
    UsageError
        When the data isn't there.
    """
    if not folder.is_dir():
        raise UsageError(f"no measured grids in {folder}", "name their folder with --grids")
    us = _us_days(folder)
    if part == TEST:
        day = read_reference(folder / "grid_ce_2022-09-17_1s.csv.gz").freq_hz
        return (Stretch("ce-2022", 50.0, 1.0, day), *us[11:])
    week = read_reference(folder / "grid_ce_2024-08-13_to_21_gappy_1s.csv.gz").freq_hz
    # It begins on 13 August at 23:07:33 UTC; its first two days and a half are mostly gaps.
    begin, end = int(2.5 * DAY_S), 4 * DAY_S
    return (Stretch("ce-2024", 50.0, 1.0, week[begin:end]), *us[:11])


def _us_days(folder: Path) -> list[Stretch]:
    with np.load(folder / "grid_us_60hz_2022-07_2s.npz", allow_pickle=False) as held:
        days, step_s = np.asarray(held["frequency"], np.float64), float(held["step_s"])
    return [Stretch(f"us-{i}", 60.0, step_s, day) for i, day in enumerate(days)]
