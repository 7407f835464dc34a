"""What came of a calibration: its lines, and how reliable they are on what they never saw."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rsenf.bench.bounds import rate_bound
from rsenf.bench.calibration.fit import (
    QUESTIONS,
    Record,
    cost_of_ratios,
    fitted,
    pairs_of,
    reliability,
)
from rsenf.match.calibration import VERSION, Line
from rsenf.match.settings import MatchSettings

_ASKED = {
    "other": "this time against another in the reference (the search counted)",
    "absent": "this time against one outside the reference (the search counted)",
    "claim": "a claimed time against another",
}


def fitted_lines(records: Sequence[Record]) -> dict[str, Line]:
    """Fit a line for each question."""
    return {question: fitted(pairs_of(records, question)) for question in QUESTIONS}


def calibration_file(lines: dict[str, Line], records: Sequence[Record]) -> dict[str, Any]:
    """Return what is kept with the matcher."""
    seeds, real = [r["seed"] for r in records], sum("damage" in r for r in records)
    return {
        "version": VERSION,
        "made": f"rsenf bench calibration: {len(records)} searches, {real} of them of real clips "
        f"made worse, seeds {min(seeds)} to {max(seeds)}, in "
        f"{', '.join(sorted({r['grid'] for r in records}))}",
        "lines": {name: dataclasses.asdict(line) for name, line in lines.items()},
    }


def tabulated(lines: dict[str, Line], records: Sequence[Record]) -> dict[str, Any]:
    """Return how reliable lines are on some searches, and what would be decided there."""
    return {
        "searches": len(records),
        "grids": sorted({r["grid"] for r in records}),
        "questions": [
            {
                "question": question,
                "line": dataclasses.asdict(lines[question]),
                "held": pairs_of(records, question).held.size,
                "failed": pairs_of(records, question).failed.size,
                "cllr_bits": cost_of_ratios(pairs_of(records, question), lines[question]),
                "rows": reliability(pairs_of(records, question), lines[question]),
            }
            for question in QUESTIONS
        ],
        "decisions": _decisions(lines, records),
        "clock": _clock(records),
    }


def _decisions(lines: dict[str, Line], records: Sequence[Record]) -> dict[str, Any]:
    limit = MatchSettings().min_log10_lr
    counts = {"present": 0, "found": 0, "found_wrong": 0, "absent": 0, "absent_found": 0}
    for record in records:
        for case in ("present", "absent"):
            best = record.get(case)
            counts[case] += 1
            if best and min(lines["other"](best["other"]), lines["absent"](best["absent"])) < limit:
                continue
            if best and case == "present":
                counts["found" if best["right"] else "found_wrong"] += 1
            elif best:
                counts["absent_found"] += 1
    return counts | {"absent_found_below": rate_bound(counts["absent_found"], counts["absent"])}


def _clock(records: Sequence[Record]) -> dict[str, float]:
    """Rms of the errors of lag and clock over their standard errors, where the time is right."""
    right = [r["present"] for r in records if r.get("present") and r["present"]["right"]]
    sure = [p for p in right if p["absent"] >= 2 and p["clock_error_ppm"] is not None]
    lag = np.array([p["lag_error_s"] / p["lag_std_s"] for p in sure])
    clock = np.array([p["clock_error_ppm"] / p["clock_std_ppm"] for p in sure])
    return {
        "cases": len(sure),
        "lag_spread": float(np.sqrt(np.mean(lag**2))) if sure else math.nan,
        "clock_spread": float(np.sqrt(np.mean(clock**2))) if sure else math.nan,
        "clock_within_two": float(np.mean(np.abs(clock) <= 2)) if sure else math.nan,
    }


def text(document: dict[str, Any]) -> str:
    """Return the outcome for a terminal."""
    lines = [f"{document['searches']} searches in {', '.join(document['grids'])}"]
    for found in document["questions"]:
        line = found["line"]
        lines += [
            "",
            f"{_ASKED[found['question']]}: held {found['held']}, failed {found['failed']}",
            f"  calibrated = {line['slope']:g} · raw {line['intercept']:+g}, at most "
            f"{line['limit']:g}; Cllr {found['cllr_bits']:.3f} bits",
            *reliability_lines(found["rows"]),
        ]
    counts, clock = document["decisions"], document["clock"]
    return "\n".join([
        *lines,
        "",
        f"match at both ratios ≥ 100: {counts['found']} of {counts['present']} present, "
        f"{counts['found_wrong']} of them wrongly; {counts['absent_found']} of "
        f"{counts['absent']} absent (below {counts['absent_found_below']:.2%} with 95 %)",
        f"errors over standard errors, rms of {clock['cases']}: lag {clock['lag_spread']:.2f}, "
        f"clock {clock['clock_spread']:.2f}, {clock['clock_within_two']:.0%} within two",
    ])  # fmt: skip


def reliability_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return how reliable ratios are, size by size."""
    head = "  log10 LR        said     came   (95 %)          held  failed"
    return [head, *map(_row, rows)]


def _row(row: dict[str, Any]) -> str:
    ends = [row["from_log10_lr"], row["to_log10_lr"]]
    low, high = ("" if end is None else f"{end:+g}" for end in ends)
    return (
        f"  {low:>4} … {high:<4}    {row['said']:7.1%}  {row['came']:7.1%}  "
        f"({row['low']:.1%} to {row['high']:.1%})".ljust(56)
        + f"{row['held']:5d} {row['failed']:7d}"
    )
