"""Opens references of a grid's frequency: from a file, the store, or an array."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from rsenf.api.shared import PathLike
from rsenf.errors import UsageError
from rsenf.match.series import Grid
from rsenf.messages.schema import FloatArray
from rsenf.reference import Reference, open_reference, reference_of
from rsenf.reference.open import utc_ns
from rsenf.reference.readings import ReadOptions
from rsenf.reference.store import StoredReference

Opened: TypeAlias = Reference | StoredReference
References: TypeAlias = PathLike | Opened | ArrayLike | Sequence[PathLike | Opened]

PIECE = 1 << 20  # samples of a piece


def open_references(
    references: References,
    *,
    start: str | None = None,
    store: PathLike | None = None,
    **reading: Any,
) -> list[Opened]:
    """Open one reference or several; equal names get numbers.

    Parameters
    ----------
    references : path, ``store:GRID``, Reference, array_like, or sequence of the first three
        An array is of frequencies in Hz, one each ``step_s``, NaN in gaps.
    start : str, optional
        Start of an array, ISO 8601, in UTC unless it has a zone; unknown by default.
    store : path, optional
        Folder of ``store:GRID``.
    **reading
        As for :class:`rsenf.reference.readings.ReadOptions`: ``step_s``, which arrays need,
        ``timezone``, ``time_format``, ``time_column``, ``column``, ``stamp`` ….

    Raises
    ------
    UsageError
        If there is no such file or grid, or an argument is invalid.
    """
    options = ReadOptions(**reading)
    named: Sequence[PathLike | Opened]
    if isinstance(references, str | os.PathLike | Opened):
        named = [references]
    elif isinstance(references, list | tuple) and any(
        isinstance(one, str | os.PathLike | Opened) for one in references
    ):
        named = references
    elif options.step_s is None:
        raise UsageError("an array is no reference without its step", "give step_s, in seconds")
    else:
        begin_ns = utc_ns(start, "start of the reference") if start else 0
        values = cast("ArrayLike", references)
        named = [
            reference_of(
                values, options.step_s, start_utc_ns=begin_ns, nominal_hz=options.nominal_hz
            )
        ]
    opened: list[Opened] = []
    names: set[str] = set()
    for one in named:
        reference = one if isinstance(one, Opened) else open_reference(
            os.fspath(one), store=store, **reading
        )  # fmt: skip
        name, number = reference.grid, 2
        while name in names:
            name, number = f"{reference.grid} ({number})", number + 1
        names.add(name)
        opened.append(dataclasses.replace(reference, grid=name))
    return opened


def grids_of(references: Sequence[Opened]) -> list[Grid]:
    """Convert references to the form that matchers take."""
    # A stored one's samples are read on demand: matchers request slices.
    return [
        Grid(r.grid, r.nominal_hz, r.t0_ns, r.step_s, cast("FloatArray", r.freq_hz), r.zone_unknown)
        for r in references
    ]


def nominal_of(references: Sequence[Opened]) -> float | None:
    """Nominal frequency of all of them; None if they differ."""
    found = {r.nominal_hz for r in references}
    return found.pop() if len(found) == 1 else None


@dataclass(frozen=True)
class Coverage:
    """Numbers of valid and missing samples; ``longest_gap`` in samples."""

    valid: int
    gaps: int
    longest_gap: int
    duplicates: int


def coverage(reference: Opened) -> Coverage:
    """Count a reference's samples, a piece at a time."""
    valid = gaps = longest = duplicates = run = 0
    for start in range(0, reference.freq_hz.size, PIECE):
        part = slice(start, start + PIECE)
        missing = np.isnan(reference.freq_hz[part])
        valid += int((~missing).sum())
        duplicates += int((reference.readings[part] > 1).sum())
        edges = np.flatnonzero(np.diff(missing, prepend=False, append=False))
        lengths = edges[1::2] - edges[::2]
        joined = bool(run and missing[0])
        gaps += lengths.size - joined
        if joined:
            lengths[0] += run
        longest = max(longest, int(lengths.max(initial=0)))
        run = int(lengths[-1]) if missing[-1] else 0
    return Coverage(valid, gaps, longest, duplicates)
