"""Records in groups: what the tables of idle and ENF have in common."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.plan import LIT
from rsenf.messages.schema import FloatArray

CELL = ("size", "frame_rate", "nominal_hz")
POOLED = ("frame_rate", "nominal_hz")  # both sizes together
# The alias at the frame rate is called 0 Hz where the grid's own deviations reach across it.
ALIAS_ZERO_HZ = 1.0
TURN_RAD = 1.0

Found = tuple[Record, dict[str, Any]]


def cells(
    records: Iterable[Record], by: Sequence[str], kind: str
) -> Iterator[tuple[dict[str, Any], dict[str, list[Found]]]]:
    """Yield each cell: what it is, and by method the clips with what the method found.

    Cells of lit clips whose alias is at 0 Hz are told apart by ``turned``: whether the grid's
    drift turns the flicker by at least a radian, without which it can't be told from texture.

    Parameters
    ----------
    records : iterable of Record
    by : sequence of str
        Fields of a record that make a cell; the coding always does.
    kind : {'idle', 'enf'}
    """
    sorted_out: dict[tuple[Any, ...], dict[str, list[Found]]] = {}
    for record in records:
        turned = _turned(record)
        for coding, found in record["found"].items():
            methods = sorted_out.setdefault((*(record[f] for f in by), coding, turned), {})
            for method, result in found[kind].items():
                methods.setdefault(method, []).append((record, result))
    for values, methods in sorted_out.items():
        yield dict(zip((*by, "coding", "turned"), values, strict=True)), methods


def _turned(record: Record) -> bool | None:
    """Whether the grid's drift turns a lit clip's flicker enough; None where it turns anyhow."""
    f0_hz, rate_hz = 2 * record["nominal_hz"], record["frames"] / record["duration_s"]
    alias_hz = abs(f0_hz - round(f0_hz / rate_hz) * rate_hz)
    if record["scene"] != LIT or alias_hz > ALIAS_ZERO_HZ:
        return None
    return bool(record["alias_turn_rad"] >= TURN_RAD)


def relative_errors(result: dict[str, Any]) -> FloatArray:
    """Errors over the standard errors that they were given with: of an ENF, or of one idle ratio.

    What was given without a standard error isn't among them.
    """
    errors = result.get("error_mhz", [result.get("error_percent")])
    stds = result.get("std_mhz", [result.get("std_percent")])
    pairs = zip(errors, stds, strict=True)
    return np.array([e / s for e, s in pairs if e is not None and s], np.float64)


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
