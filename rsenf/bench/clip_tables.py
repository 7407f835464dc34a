"""Records of clips to the rows of the tables of idle, enf and claims.

A cell has clips of one size, frame rate, grid and coding. A table has a row for each cell and
method.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.plan import LIT, LOSSLESS
from rsenf.bench.tables import median, rate_bound, rms, versions_of, worst
from rsenf.messages.schema import FloatArray
from rsenf.track import TrackSettings

CELL = ("size", "frame_rate", "nominal_hz")
POOLED = ("frame_rate", "nominal_hz")  # both sizes together
# The alias counts as at 0 Hz within the range of the grid's deviations.
ALIAS_ZERO_HZ = 1.0
TURN_RAD = 1.0

Found = tuple[Record, dict[str, Any]]


def cells(
    records: Iterable[Record], by: Sequence[str], kind: str
) -> Iterator[tuple[dict[str, Any], dict[str, list[Found]]]]:
    """Yield the cells, each with its clips and the results on them by method.

    Clips whose alias is at 0 Hz are split by ``turned``: whether the grid's deviation turns the
    flicker's phase by at least 1 rad, without which it can't be separated from texture.

    Parameters
    ----------
    records : iterable of Record
    by : sequence of str
        Fields of a record with one value in a cell, beside its coding.
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


def cpu_ms_per_s(found: Sequence[Found]) -> float | None:
    """Return the mean processor time for a second of video, ms."""
    used = [(r["cpu_s"], record["duration_s"]) for record, r in found if "cpu_s" in r]
    return 1e3 * sum(s for s, _ in used) / sum(d for _, d in used) if used else None


IDLE_DEFAULT = "coherent"
# Average error over each of five cameras, six videos of 720p at 29.97 fps each, percentage points
# (the paper's table of idle period estimation statistics).
PAPER_AVERAGE_ERROR_PERCENT = (1.66, 4.16, 2.91, 2.50, 5.00)
# Limits of the median error, percentage points, by coding; another one for lossless at 0 Hz.
IDLE_MARKS_PERCENT = {LOSSLESS: 0.01, "150k": 0.5, "50k": 1.0}
MARK_ALIAS_ZERO_PERCENT = 0.1
VERDICTS = ("estimated", "ambiguous", "refused", "no_signal")


def idle_rows(records: Iterable[Record], by: Sequence[str] = CELL) -> list[dict[str, Any]]:
    """Return a row for each cell and method; errors in percentage points of the frame period.

    Errors are those of the clips with an estimate; the others are counted by verdict. ``beaten``
    counts clips in which another method's error is smaller by more than this one's standard error.

    Parameters
    ----------
    records : iterable of dict
    by : sequence of str, optional
        Fields with one value in a cell.
    """
    return [
        cell
        | {"method": method}
        | _idle_row(found)
        | {"beaten": _beaten(found, [f for m, f in methods.items() if m != method])}
        | _idle_mark(cell, method)
        for cell, methods in cells(records, by, "idle")
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
    """Return the absolute error of an estimate; None without one."""
    if result.get("verdict") != "estimated" or result["error_percent"] is None:
        return None
    return abs(float(result["error_percent"]))


def _idle_mark(cell: dict[str, Any], method: str) -> dict[str, Any]:
    if method != IDLE_DEFAULT or cell["turned"] is False:
        return {"mark_percent": None}
    if cell["turned"] and cell["coding"] == LOSSLESS:
        return {"mark_percent": MARK_ALIAS_ZERO_PERCENT}
    return {"mark_percent": IDLE_MARKS_PERCENT.get(cell["coding"])}


ENF_DEFAULT = "projection"
# Limits of the median clip's rms error, mHz, of clips with at least so many levels of flicker.
ENF_MARKS_MHZ = {LOSSLESS: 0.5, "50k": 1.1}
MARK_LEVEL = 5.0


def enf_rows(records: Iterable[Record], by: Sequence[str] = CELL) -> list[dict[str, Any]]:
    """Return a row for each cell and method; errors in mHz against the mean of a second.

    A clip's error is the rms over its usable values. ``bright``: clips whose flicker has at least
    :data:`MARK_LEVEL` levels. ``within``: the part of a clip in which a window of 20 s is full, to
    compare methods with and without such a window.
    """
    return [
        cell
        | {"method": method}
        | _enf_row(found)
        | {"worse_than_stft": _worse(found, methods.get("stft", []))}
        | {"mark_mhz": _enf_mark(cell, method)}
        for cell, methods in cells(records, by, "enf")
        for method, found in methods.items()
    ]


def _enf_mark(cell: dict[str, Any], method: str) -> float | None:
    if method != ENF_DEFAULT or cell["turned"] is False:
        return None
    return ENF_MARKS_MHZ.get(cell["coding"])


def _enf_row(found: Sequence[Found]) -> dict[str, Any]:
    whole = [_clip_rms(record, r) for record, r in found]
    bright = [e for e, (record, _) in zip(whole, found, strict=True) if _is_bright(record)]
    relative = np.concatenate([relative_errors(r) for _, r in found])
    return {
        "clips": len(found),
        "with_values": sum(e is not None for e in whole),
        "broke": sum("broke" in r for _, r in found),
        "usable_ratio": sum(len(r.get("t_s", ())) for _, r in found)
        / sum(record["duration_s"] for record, _ in found),
        "median_mhz": median(_known(whole)),
        "worst_mhz": worst(_known(whole)),
        "bright_clips": len(bright),
        "bright_with_values": len(_known(bright)),
        "bright_median_mhz": median(_known(bright)),
        "bright_worst_mhz": worst(_known(bright)),
        "within_median_mhz": median(_known([_within_rms(record, r) for record, r in found])),
        "std_mhz": median([s for _, r in found for s in r.get("std_mhz", ()) if s]),
        "spread": rms(relative.tolist()),
        "beyond_3_std_ratio": float(np.mean(np.abs(relative) > 3)) if relative.size else None,
        "bound_mhz": median([record["enf_bound_mhz"] for record, _ in found]),
        "cpu_ms_per_s": cpu_ms_per_s(found),
    }


def _is_bright(record: Record) -> bool:
    return bool(record["flicker_level"] >= MARK_LEVEL)


def _known(values: Iterable[float | None]) -> list[float]:
    return [v for v in values if v is not None]


def _clip_rms(record: Record, result: dict[str, Any]) -> float | None:
    return rms(_known(result.get("error_mhz", ())))


def _within_rms(record: Record, result: dict[str, Any]) -> float | None:
    half_s = TrackSettings.window_s / 2
    begin_s, end_s = half_s, record["duration_s"] - half_s
    values = zip(result.get("t_s", ()), result.get("error_mhz", ()), strict=True)
    return rms(_known(e for t, e in values if begin_s <= t <= end_s))


def _worse(found: Sequence[Found], stft: Sequence[Found]) -> int:
    """Count clips in which the STFT has the smaller error, of those in which both have one."""
    plain = {record["key"]: _within_rms(record, r) for record, r in stft}
    pairs = ((_within_rms(record, r), plain.get(record["key"])) for record, r in found)
    return sum(a is not None and b is not None and a > b for a, b in pairs)


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
        cell | {"kind": kind, "method": method} | _claims_row(found)
        for kind in ("idle", "enf")
        for cell, methods in cells([*known, *everything], ("scene",), kind)
        for method, found in methods.items()
    ]


def _claims_row(found: Sequence[Found]) -> dict[str, Any]:
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
    """Whether a method gives an idle ratio, or at least one usable second of ENF."""
    if result.get("t_s"):
        return True
    return result.get("verdict") in _CLAIMING and result["idle_percent"] is not None


def _is_right(record: Record, result: dict[str, Any]) -> bool:
    if not claimed(result) or record.get("of", record["scene"]) != FLICKERING:
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
    document: dict[str, Any] = {
        "table": table,
        "clips": len(records),
        "seeds": sorted({record["seed"] for record in records}),
        "durations_s": sorted({record["duration_s"] for record in records}),
        "grids": sorted({record["grid"] for record in records}),
        "versions": versions_of(records),
    }
    if table == "idle":
        document["paper_average_error_percent"] = PAPER_AVERAGE_ERROR_PERCENT
        document["rows"] = idle_rows(records, by)
    elif table == "enf":
        document["rows"] = enf_rows(records, by)
    else:
        document["rows"] = claims_rows(records)
    return document
