"""Records to the table of ENF estimators."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.groups import CELL, Found, cells, cpu_ms_per_s, median, relative_errors, rms, worst
from rsenf.bench.plan import LOSSLESS
from rsenf.track import TrackSettings

DEFAULT = "projection"
# rms to reach in the median clip, for clips whose flicker has at least so many levels.
MARKS_MHZ = {LOSSLESS: 0.5, "50k": 1.1}
MARK_LEVEL = 5.0


def enf_rows(records: Iterable[Record], by: Sequence[str] = CELL) -> list[dict[str, Any]]:
    """Return a row for each cell and method; errors in mHz against the mean of a second.

    A clip's error is the rms over its usable values. ``bright`` are the clips whose flicker has
    at least :data:`MARK_LEVEL` levels. ``within`` is the part of each clip in which a window of
    20 s is full, so that methods with and without such a window are held against each other.
    """
    return [
        cell
        | {"method": method}
        | _row(found)
        | {"worse_than_stft": _worse(found, methods.get("stft", []))}
        | {"mark_mhz": _mark(cell, method)}
        for cell, methods in cells(records, by, "enf")
        for method, found in methods.items()
    ]


def _mark(cell: dict[str, Any], method: str) -> float | None:
    if method != DEFAULT or cell["turned"] is False:
        return None
    return MARKS_MHZ.get(cell["coding"])


def _row(found: Sequence[Found]) -> dict[str, Any]:
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
    """Count clips in which the plain method did better where both could."""
    plain = {record["key"]: _within_rms(record, r) for record, r in stft}
    pairs = ((_within_rms(record, r), plain.get(record["key"])) for record, r in found)
    return sum(a is not None and b is not None and a > b for a, b in pairs)
