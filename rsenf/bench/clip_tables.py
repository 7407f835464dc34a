"""Records of clips to the rows of the tables of idle, enf and claims.

A cell has clips of one size, frame rate, grid and coding. A table has a row for each cell and
method.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.plan import LIT
from rsenf.bench.tables import median, rate_bound, rms, versions_of, worst
from rsenf.messages.schema import FloatArray

CELL = ("size", "frame_rate", "nominal_hz")
POOLED = ("frame_rate", "nominal_hz")  # both sizes together
# The alias counts as at 0 Hz within the range of the grid's deviations.
ALIAS_ZERO_HZ = 1.0
TURN_RAD = 1.0

Found = tuple[Record, dict[str, Any]]


def _cells(
    records: Iterable[Record], by: Sequence[str], kind: str
) -> Iterator[tuple[dict[str, Any], dict[str, list[Found]]]]:
    """Yield the cells, of equal fields and coding, each with the results on its clips by method.

    Clips whose alias is at 0 Hz are split by ``turned``: whether the grid's deviation turns the
    flicker's phase by at least 1 rad, without which it can't be separated from texture.
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
    """Whether an alias at 0 Hz turns by at least 1 rad; None of any other alias."""
    f0_hz, rate_hz = 2 * record["nominal_hz"], record["frames"] / record["duration_s"]
    alias_hz = abs(f0_hz - round(f0_hz / rate_hz) * rate_hz)
    if record["scene"] != LIT or alias_hz > ALIAS_ZERO_HZ:
        return None
    return bool(record["alias_turn_rad"] >= TURN_RAD)


def relative_errors(result: dict[str, Any]) -> FloatArray:
    """Return errors over their estimated standard errors, of ENF estimates or of one idle ratio.

    Estimates without a standard error are left out.
    """
    errors = result.get("error_mhz", [result.get("error_percent")])
    stds = result.get("std_mhz", [result.get("std_percent")])
    pairs = zip(errors, stds, strict=True)
    return np.array([e / s for e, s in pairs if e is not None and s], np.float64)


def _cpu_ms_per_s(found: Sequence[Found]) -> float | None:
    """Return the mean processor time for a second of video, ms."""
    used = [(r["cpu_s"], record["duration_s"]) for record, r in found if "cpu_s" in r]
    return 1e3 * sum(s for s, _ in used) / sum(d for _, d in used) if used else None


IDLE_DEFAULT = "coherent"
# Average error over each of five cameras, six videos of 720p at 29.97 fps each, percentage points
# (the paper's table of idle period estimation statistics).
PAPER_AVERAGE_ERROR_PERCENT = (1.66, 4.16, 2.91, 2.50, 5.00)
VERDICTS = ("estimated", "ambiguous", "refused", "no_signal")


def idle_rows(records: Iterable[Record], by: Sequence[str] = CELL) -> list[dict[str, Any]]:
    """Return a row for each cell and method; errors in percentage points of the frame period.

    Errors are those of the clips with an estimate; the others are counted by verdict.

    Parameters
    ----------
    records : iterable of dict
    by : sequence of str, optional
        Fields with one value in a cell.
    """
    return _rows(records, by, "idle", _idle_row)


def _rows(
    records: Iterable[Record],
    by: Sequence[str],
    kind: str,
    row: Callable[[Sequence[Found]], dict[str, Any]],
) -> list[dict[str, Any]]:
    """Return a row for each cell and method."""
    return [
        cell | {"kind": kind, "method": method, "clips": len(found)} | row(found)
        for cell, methods in _cells(records, by, kind)
        for method, found in methods.items()
    ]


def _idle_row(found: Sequence[Found]) -> dict[str, Any]:
    verdicts = Counter("broke" if "broke" in r else r["verdict"] for _, r in found)
    given = [r for _, r in found if _error(r) is not None]
    errors = [abs(r["error_percent"]) for r in given]
    stds = [r["std_percent"] for r in given if r["std_percent"]]
    relative = [e for r in given for e in relative_errors(r).tolist()]
    bounds = [record["idle_bound_percent"] for record, _ in found]
    return {
        **{verdict: verdicts[verdict] for verdict in (*VERDICTS, "broke")},
        "median_percent": median(errors),
        "worst_percent": worst(errors),
        "std_percent": median(stds),
        "spread": rms(relative),
        "bound_percent": median(bounds),
        "cpu_ms_per_s": _cpu_ms_per_s(found),
    }


def _error(result: dict[str, Any]) -> float | None:
    """Return the absolute error of an estimate; None without one."""
    if result.get("verdict") != "estimated" or result["error_percent"] is None:
        return None
    return abs(float(result["error_percent"]))


def enf_rows(records: Iterable[Record], by: Sequence[str] = CELL) -> list[dict[str, Any]]:
    """Return a row for each cell and method; errors in mHz against the mean of a second.

    A clip's error is the rms over its usable values.
    """
    return _rows(records, by, "enf", _enf_row)


def _enf_row(found: Sequence[Found]) -> dict[str, Any]:
    results = [result for _, result in found]
    clips = [rms([e for e in r.get("error_mhz", ()) if e is not None]) for r in results]
    known = [error for error in clips if error is not None]
    relative = np.concatenate([relative_errors(result) for result in results])
    seconds = sum(record["duration_s"] for record, _ in found)
    return {
        "with_values": len(known),
        "broke": sum("broke" in r for r in results),
        "usable_ratio": sum(len(r.get("t_s", ())) for r in results) / seconds,
        "median_mhz": median(known),
        "worst_mhz": worst(known),
        "std_mhz": median([s for r in results for s in r.get("std_mhz", ()) if s]),
        "spread": rms(relative.tolist()),
        "beyond_3_std_ratio": float(np.mean(np.abs(relative) > 3)) if relative.size else None,
        "bound_mhz": median([record["enf_bound_mhz"] for record, _ in found]),
        "cpu_ms_per_s": _cpu_ms_per_s(found),
    }


ALL = "all"
# The one scene with a rest of flicker: the exposure is a nominal period of it.
FLICKERING = "anti_flicker"
RIGHT_WITHIN_STD = 3.0
_CLAIMING = ("estimated", "ambiguous")


def claims_rows(records: Iterable[Record]) -> list[dict[str, Any]]:
    """Return false claims by scene, of all scenes, by coding and method, with 95 % bounds.

    ``right`` counts correct claims: an exposure of one flicker period removes the flicker only
    where the grid is exactly at its nominal frequency.
    """
    known = list(records)
    everything = [record | {"of": record["scene"], "scene": ALL} for record in known]
    return [
        row
        for kind in ("idle", "enf")
        for row in _rows([*known, *everything], ("scene",), kind, _claims_row)
    ]


def _claims_row(found: Sequence[Found]) -> dict[str, Any]:
    claims = sum(_claimed(result) for _, result in found)
    right = sum(_is_right(record, result) for record, result in found)
    return {
        "claims": claims,
        "bound_ratio": rate_bound(claims, len(found)),
        "right": right,
        "false_bound_ratio": rate_bound(claims - right, len(found)),
        "broke": sum("broke" in result for _, result in found),
        "cpu_ms_per_s": _cpu_ms_per_s(found),
    }


def _claimed(result: dict[str, Any]) -> bool:
    """Whether a method gives an idle ratio, or at least one usable second of ENF."""
    if result.get("t_s"):
        return True
    return result.get("verdict") in _CLAIMING and result["idle_percent"] is not None


def _is_right(record: Record, result: dict[str, Any]) -> bool:
    if not _claimed(result) or record.get("of", record["scene"]) != FLICKERING:
        return False
    relative = relative_errors(result)
    return bool(relative.size and np.median(np.abs(relative)) <= RIGHT_WITHIN_STD)


def tabulated(table: str, records: Sequence[Record], *, pooled: bool = False) -> dict[str, Any]:
    """Return a table's rows, and the seeds, grids and versions behind them.

    Parameters
    ----------
    table : {'idle', 'enf', 'claims'}
    records : sequence of Record
    pooled : bool, optional
        Whether all sizes are one cell.
    """
    by = POOLED if pooled else CELL
    rows = {"idle": idle_rows, "enf": enf_rows}
    return {
        "table": table,
        "clips": len(records),
        "seeds": sorted({record["seed"] for record in records}),
        "durations_s": sorted({record["duration_s"] for record in records}),
        "grids": sorted({record["grid"] for record in records}),
        "versions": versions_of(records),
        "rows": rows[table](records, by) if table in rows else claims_rows(records),
    }
