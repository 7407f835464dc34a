"""The grid's day that the light of the films follows, and the references a piece is searched in."""

from __future__ import annotations

import dataclasses
import functools
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsenf.bench.grids import CE_2024, MEASURED
from rsenf.bench.recording_time.plan import DAY_S, NOMINAL_HZ, Film
from rsenf.model import synthetic_grid
from rsenf.reference import Reference, read_reference
from rsenf.timebase import NS_PER_S, nanoseconds

# 2024-08-18 UTC; data before it is for calibration.
OTHER_FROM_NS = 1_723_939_200 * NS_PER_S
_SEEDS = (50, 51)  # of synthetic days


@functools.cache
def lit_day(grids: Path | None) -> Reference:
    """Return the day that the light of the films follows.

    Parameters
    ----------
    grids : Path or None
        Folder of measured grids; without it or its file, the day is synthetic.
    """
    path = grids / MEASURED[NOMINAL_HZ] if grids else None
    return read_reference(path) if path and path.is_file() else _synthetic(_SEEDS[0])


@functools.cache
def other_day(grids: Path | None) -> Reference:
    """Return 24 h of another year, those with the fewest gaps; none of the data for calibration."""
    path = grids / CE_2024 if grids else None
    if not path or not path.is_file():
        return _synthetic(_SEEDS[1])
    whole = read_reference(path)
    first = max(-(-(OTHER_FROM_NS - whole.t0_ns) // nanoseconds(whole.step_s)), 0)
    length = round(DAY_S / whole.step_s)
    valid = np.concatenate(([0], np.cumsum(np.isfinite(whole.freq_hz[first:]))))
    return stretch(whole, first + int(np.argmax(valid[length:] - valid[:-length])), length)


def stretch(reference: Reference, first: int, samples: int) -> Reference:
    """Return a part of a reference, from sample ``first`` on."""
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


NOISE_HZ = 0.3e-3
STEP_HZ = 1e-4  # resolution of published values
GAP_S = 600.0  # margin of the gap on either side of the piece
PRESENT = "present"
ABSENT = ("same_day", "other_day")


@dataclass(frozen=True, eq=False)
class Searched:
    """A reference of a trial.

    Parameters
    ----------
    trial : str
        :data:`PRESENT`, or one of :data:`ABSENT`: the film's day with a gap at its time, and a day
        of another year.
    reference : Reference
    """

    trial: str
    reference: Reference


def references_of(
    film: Film, begin_s: float, end_s: float, noise_hz: float, grids: Path | None
) -> Iterator[Searched]:
    """Yield the references for a piece of a film.

    Each has independent noise and is rounded. All codings of a piece have the same references.

    Parameters
    ----------
    film : Film
    begin_s, end_s : float
        Of the piece, from the start of the day.
    noise_hz : float
    grids : Path or None
        Folder of measured grids.
    """
    day, other = (
        stretch(of, 0, round(film.reference_s / of.step_s))
        for of in (lit_day(grids), other_day(grids))
    )
    for trial, reference in (
        (PRESENT, day),
        (ABSENT[0], _without(day, begin_s - GAP_S, end_s + GAP_S)),
        (ABSENT[1], other),
    ):
        seed = zlib.crc32(f"{film.kind} {trial} {begin_s:.3f} {end_s:.3f}".encode())
        yield Searched(
            trial, _measured(reference, noise_hz, np.random.default_rng([film.seed, seed]))
        )


def _without(reference: Reference, begin_s: float, end_s: float) -> Reference:
    """Return a reference with a gap, of all samples that overlap it."""
    first, stop = math.floor(begin_s / reference.step_s), math.ceil(end_s / reference.step_s)
    kept = np.arange(reference.freq_hz.size)
    missing = (kept >= first) & (kept < stop)
    return dataclasses.replace(
        reference,
        freq_hz=np.where(missing, np.nan, reference.freq_hz),
        readings=np.where(missing, 0, reference.readings).astype(np.uint32),
    )


def _measured(reference: Reference, noise_hz: float, rng: np.random.Generator) -> Reference:
    noisy = reference.freq_hz + noise_hz * rng.standard_normal(reference.freq_hz.size)
    return dataclasses.replace(reference, freq_hz=np.round(noisy / STEP_HZ) * STEP_HZ)
