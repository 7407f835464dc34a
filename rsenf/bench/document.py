"""A table with what it was made from, as plain values.

Records of scenes with nothing to claim, to the table of false claims.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.bounds import rate_bound
from rsenf.bench.enf_table import enf_rows
from rsenf.bench.groups import CELL, POOLED, Found, cells, cpu_ms_per_s, relative_errors
from rsenf.bench.idle_table import PAPER_AVERAGE_ERROR_PERCENT, idle_rows

ALL = "all"
# The one of these scenes with mains light in it: what an exposure that nearly suits it leaves.
FLICKERING = "anti_flicker"
RIGHT_WITHIN_STD = 3.0
_CLAIMING = ("estimated", "ambiguous")


def claims_rows(records: Iterable[Record]) -> list[dict[str, Any]]:
    """Return a row for each scene, for all of them, coding and method, with the 95 % bound.

    ``right`` counts the claims that are true all the same: an exposure of one period of the
    flicker takes all of it only where the grid is exactly at its nominal frequency.
    """
    known = list(records)
    everything = [record | {"of": record["scene"], "scene": ALL} for record in known]
    return [
        cell | {"kind": kind, "method": method} | _row(found)
        for kind in ("idle", "enf")
        for cell, methods in cells([*known, *everything], ("scene",), kind)
        for method, found in methods.items()
    ]


def _row(found: Sequence[Found]) -> dict[str, Any]:
    claims = sum(claimed(result) for _, result in found)
    right = sum(_is_right(record, result) for record, result in found)
    return {
        "clips": len(found),
        "claims": claims,
        "bound_ratio": rate_bound(claims, len(found)),
        "right": right,
        "false_bound_ratio": rate_bound(claims - right, len(found)),
        "broke": sum("broke" in result for _, result in found),
        "cpu_ms_per_s": cpu_ms_per_s(found),
    }


def claimed(result: dict[str, Any]) -> bool:
    """Whether a method claims to have found something: an idle ratio, or one second of ENF."""
    if result.get("t_s"):
        return True
    return result.get("verdict") in _CLAIMING and result["idle_percent"] is not None


def _is_right(record: Record, result: dict[str, Any]) -> bool:
    if not claimed(result) or record.get("of", record["scene"]) != FLICKERING:
        return False
    relative = relative_errors(result)
    return bool(relative.size and np.median(np.abs(relative)) <= RIGHT_WITHIN_STD)


def tabulate(table: str, records: Sequence[Record], *, pooled: bool = False) -> dict[str, Any]:
    """Return a table's rows, and the seeds, grids and versions behind them.

    Parameters
    ----------
    table : {'idle', 'enf', 'claims'}
    records : sequence of Record
    pooled : bool, optional
        All sizes together.
    """
    by = POOLED if pooled else CELL
    document: dict[str, Any] = {
        "table": table,
        "clips": len(records),
        "seeds": sorted({record["seed"] for record in records}),
        "durations_s": sorted({record["duration_s"] for record in records}),
        "grids": sorted({record["grid"] for record in records}),
        "versions": [dict(v) for v in sorted({tuple(r["versions"].items()) for r in records})],
    }
    if table == "idle":
        document["paper_average_error_percent"] = PAPER_AVERAGE_ERROR_PERCENT
        document["rows"] = idle_rows(records, by)
    elif table == "enf":
        document["rows"] = enf_rows(records, by)
    else:
        document["rows"] = claims_rows(records)
    return document
