"""References named on a command line: opened, told apart, and as the matchers take them."""

from __future__ import annotations

import argparse
import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

if TYPE_CHECKING:
    from rsenf.match.series import Grid
    from rsenf.messages import MatchResult
    from rsenf.messages.schema import FloatArray
    from rsenf.reference import Reference
    from rsenf.reference.store import StoredReference

    Opened = Reference | StoredReference

PIECE = 1 << 20  # samples looked at together


def open_references(args: argparse.Namespace) -> list[Opened]:
    """Open every ``--reference``; two of one name get numbers."""
    from rsenf.cli.console import read_options
    from rsenf.reference import open_reference

    opened: list[Opened] = []
    names: set[str] = set()
    for spec in args.reference:
        reference = open_reference(
            spec,
            store=args.store,
            **read_options(args),
        )
        name, number = reference.grid, 2
        while name in names:
            name, number = f"{reference.grid} ({number})", number + 1
        names.add(name)
        opened.append(dataclasses.replace(reference, grid=name))
    return opened


def grids_of(references: list[Opened]) -> list[Grid]:
    """Return references as matchers take them."""
    from rsenf.match.series import Grid

    # A stored one's samples are read as they are asked for: matchers ask for slices.
    return [
        Grid(r.grid, r.nominal_hz, r.t0_ns, r.step_s, cast("FloatArray", r.freq_hz))
        for r in references
    ]


@dataclass(frozen=True)
class Coverage:
    """Samples that there are and aren't; ``longest_gap`` in samples."""

    valid: int
    gaps: int
    longest_gap: int
    duplicates: int


def coverage(reference: Opened) -> Coverage:
    """Count what a reference has, a piece at a time."""
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


def nominal_of(references: list[Opened]) -> float | None:
    """Nominal frequency of all of them; None when they differ."""
    found = {r.nominal_hz for r in references}
    return found.pop() if len(found) == 1 else None


def found_in(result: MatchResult, references: list[Opened]) -> Opened:
    """Return the reference that a result is in."""
    return next((r for r in references if r.grid == result.grid), references[0])
