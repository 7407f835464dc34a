"""Days of the grid: the one that the light follows, and one on which nothing was filmed."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from rsenf.bench.grids import MEASURED
from rsenf.bench.recording_time.plan import DAY_S, NOMINAL_HZ
from rsenf.model import synthetic_grid
from rsenf.reference import Reference, read_reference
from rsenf.timebase import NS_PER_S, nanoseconds

OTHER = "grid_ce_2024-08-13_to_21_gappy_1s.csv.gz"
# Before 2024-08-18 UTC that file is for calibration.
OTHER_FROM_NS = 1_723_939_200 * NS_PER_S
_SEEDS = (50, 51)  # of the days where there is no measured data


@functools.cache
def lit_day(grids: Path | None) -> Reference:
    """Return the day that the light of the films follows.

    Parameters
    ----------
    grids : Path or None
        Folder of measured grids; without it, or without the file in it, the day is synthetic.
    """
    path = grids / MEASURED[NOMINAL_HZ] if grids else None
    return read_reference(path) if path and path.is_file() else _synthetic(_SEEDS[0])


@functools.cache
def other_day(grids: Path | None) -> Reference:
    """Return 24 h of another time, those with the fewest gaps, that calibration hasn't seen."""
    path = grids / OTHER if grids else None
    if not path or not path.is_file():
        return _synthetic(_SEEDS[1])
    whole = read_reference(path)
    first = max(-(-(OTHER_FROM_NS - whole.t0_ns) // nanoseconds(whole.step_s)), 0)
    length = round(DAY_S / whole.step_s)
    valid = np.concatenate(([0], np.cumsum(np.isfinite(whole.freq_hz[first:]))))
    return stretch(whole, first + int(np.argmax(valid[length:] - valid[:-length])), length)


def stretch(reference: Reference, first: int, samples: int) -> Reference:
    """Cut some samples out of a reference."""
    part = slice(first, first + samples)
    return Reference(
        grid=reference.grid,
        nominal_hz=reference.nominal_hz,
        t0_ns=reference.t0_ns + nanoseconds(first * reference.step_s) if reference.t0_ns else 0,
        step_s=reference.step_s,
        freq_hz=reference.freq_hz[part],
        readings=reference.readings[part],
    )


def _synthetic(seed: int) -> Reference:
    freq_hz = synthetic_grid(seed, DAY_S, nominal_hz=NOMINAL_HZ).freq_hz[: int(DAY_S)]
    return Reference("synthetic", NOMINAL_HZ, 0, 1.0, freq_hz, np.ones(freq_hz.size, np.uint32))
