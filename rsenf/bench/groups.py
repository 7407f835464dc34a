"""Records in groups: what the tables of idle and ENF have in common."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from rsenf.bench.results import Record

CELL = ("size", "frame_rate", "nominal_hz")
POOLED = ("frame_rate", "nominal_hz")  # both sizes together
# The alias at the frame rate is called 0 Hz where the grid's own deviations reach across it.
ALIAS_ZERO_HZ = 1.0

Found = tuple[Record, dict[str, Any]]


def cells(
    records: Iterable[Record], by: Sequence[str], kind: str
) -> Iterator[tuple[dict[str, Any], dict[str, list[Found]]]]:
    """Yield each cell: what it is, and by method the clips with what the method found.

    Parameters
    ----------
    records : iterable of Record
    by : sequence of str
        Fields of a record that make a cell; the coding always does.
    kind : {'idle', 'enf'}
    """
    sorted_out: dict[tuple[Any, ...], dict[str, list[Found]]] = {}
    for record in records:
        for coding, found in record["found"].items():
            methods = sorted_out.setdefault((*(record[f] for f in by), coding), {})
            for method, result in found[kind].items():
                methods.setdefault(method, []).append((record, result))
    for values, methods in sorted_out.items():
        cell = dict(zip((*by, "coding"), values, strict=True))
        if "frame_rate" in cell:
            cell["alias_zero"] = alias_zero(float(cell["frame_rate"]), cell["nominal_hz"])
        yield cell, methods


def alias_zero(frame_rate_hz: float, nominal_hz: float) -> bool:
    """Whether the flicker's alias at the frame rate is at 0 Hz, or as good as."""
    f0_hz = 2 * nominal_hz
    return abs(f0_hz - round(f0_hz / frame_rate_hz) * frame_rate_hz) < ALIAS_ZERO_HZ


def cpu_ms_per_s(found: Sequence[Found]) -> float | None:
    """Return the processor time for a second of video, milliseconds, in the mean."""
    used = [(r["cpu_s"], record["duration_s"]) for record, r in found if "cpu_s" in r]
    return 1e3 * sum(s for s, _ in used) / sum(d for _, d in used) if used else None


def median(values: Sequence[float]) -> float | None:
    """Median; None of nothing."""
    return float(np.median(values)) if len(values) else None


def worst(values: Sequence[float]) -> float | None:
    """Largest; None of nothing."""
    return float(np.max(values)) if len(values) else None


def rms(values: Sequence[float]) -> float | None:
    """Root of the mean square; None of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None
