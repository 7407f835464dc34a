"""Records to the table of idle-period estimators."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench.groups import CELL, Found, cells, cpu_ms_per_s, median, relative_errors, rms, worst
from rsenf.bench.plan import LOSSLESS

DEFAULT = "coherent"
# Average error over each of five cameras, six videos of 720p at 29.97 fps each, percentage points
# (the paper's table of idle period estimation statistics).
PAPER_AVERAGE_ERROR_PERCENT = (1.66, 4.16, 2.91, 2.50, 5.00)
# Median errors to reach, percentage points; where the alias is 0 Hz, another for lossless.
MARKS_PERCENT = {LOSSLESS: 0.01, "150k": 0.5, "50k": 1.0}
MARK_ALIAS_ZERO_PERCENT = 0.1
VERDICTS = ("estimated", "ambiguous", "refused", "no_signal")


def idle_rows(records: Iterable[Record], by: Sequence[str] = CELL) -> list[dict[str, Any]]:
    """Return a row for each cell and method; errors in percentage points of the frame period.

    Errors are those of the clips that were estimated; all others are counted, each as what it is.
    ``beaten`` counts clips in which another method came nearer to the truth by more than this
    one's own standard error.
    """
    return [
        cell
        | {"method": method}
        | _row(found)
        | {"beaten": _beaten(found, [f for m, f in methods.items() if m != method])}
        | _mark(cell, method)
        for cell, methods in cells(records, by, "idle")
        for method, found in methods.items()
    ]


def _row(found: Sequence[Found]) -> dict[str, Any]:
    verdicts = Counter("broke" if "broke" in r else r["verdict"] for _, r in found)
    given = [r for _, r in found if _error(r) is not None]
    errors = [abs(r["error_percent"]) for r in given]
    stds = [r["std_percent"] for r in given if r["std_percent"]]
    relative = [e for r in given for e in relative_errors(r).tolist()]
    bounds = [record["idle_bound_percent"] for record, _ in found]
    return {
        "clips": len(found),
        **{verdict: verdicts[verdict] for verdict in (*VERDICTS, "broke")},
        "median_percent": median(errors),
        "worst_percent": worst(errors),
        "std_percent": median(stds),
        "spread": rms(relative),
        "bound_percent": median(bounds),
        "cpu_ms_per_s": cpu_ms_per_s(found),
    }


def _beaten(found: Sequence[Found], others: Sequence[Sequence[Found]]) -> int:
    nearest: dict[str, float] = {}
    for record, result in (pair for other in others for pair in other):
        error = _error(result)
        if error is not None:
            nearest[record["key"]] = min(error, nearest.get(record["key"], error))
    return sum(
        error - nearest[record["key"]] > (result["std_percent"] or 0.0)
        for record, result in found
        if (error := _error(result)) is not None and record["key"] in nearest
    )


def _error(result: dict[str, Any]) -> float | None:
    """Size of the error of a clip that was estimated."""
    if result.get("verdict") != "estimated" or result["error_percent"] is None:
        return None
    return abs(float(result["error_percent"]))


def _mark(cell: dict[str, Any], method: str) -> dict[str, Any]:
    if method != DEFAULT or cell["turned"] is False:
        return {"mark_percent": None}
    if cell["turned"] and cell["coding"] == LOSSLESS:
        return {"mark_percent": MARK_ALIAS_ZERO_PERCENT}
    return {"mark_percent": MARKS_PERCENT.get(cell["coding"])}
