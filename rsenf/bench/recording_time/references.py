"""The references that a piece is searched in: one with its time in it, and two without."""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsenf.bench.recording_time.days import lit_day, other_day, stretch
from rsenf.bench.recording_time.plan import Film
from rsenf.reference import Reference

NOISE_HZ = 0.3e-3
STEP_HZ = 1e-4  # that published values are rounded to
GAP_S = 600.0  # beyond the piece, on either side
PRESENT = "present"
ABSENT = ("same_day", "other_day")


@dataclass(frozen=True, eq=False)
class Searched:
    """A reference to search.

    Parameters
    ----------
    trial : str
        :data:`PRESENT`, or one of :data:`ABSENT`: the day of the film without the time about it,
        and a day of another year.
    reference : Reference
    """

    trial: str
    reference: Reference


def references_of(
    film: Film, begin_s: float, end_s: float, noise_hz: float, grids: Path | None
) -> Iterator[Searched]:
    """Yield the references for a piece of a film.

    Each has noise of its own, from the film's seed and the piece's place, and is rounded: light and
    reference would be the same numbers otherwise. All codings of the piece meet the same ones.

    Parameters
    ----------
    film : Film
    begin_s, end_s : float
        Of the piece, from the beginning of the day.
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
    """Make a gap, of all samples that touch it."""
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
