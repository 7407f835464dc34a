"""The benchmarks of clips: records to the tables of idle, enf and claims.

A cell has clips of one size, frame rate, grid and coding. A table has a row for each cell and
method.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.harness import BenchRun, Made
from rsenf.bench.measure import measure as measure_clip
from rsenf.bench.scenes import LIT, Plan
from rsenf.bench.statistics import Row, grouped, median, origin_of, rate_bound, rms, worst
from rsenf.bench.tables import NONE, Column, by_method, made_from, shown, table_of, written
from rsenf.messages.schema import FloatArray

CELL = ("size", "frame_rate", "nominal_hz")
POOLED = ("frame_rate", "nominal_hz")  # both sizes together
# The alias counts as at 0 Hz within the range of the grid's deviations.
ALIAS_ZERO_HZ = 1.0
TURN_RAD = 1.0

VERDICTS = ("estimated", "ambiguous", "refused", "no_signal")
# Average error over each of five cameras, six videos of 720p at 29.97 fps each, percentage points
# (the paper's table of idle period estimation statistics).
PAPER_AVERAGE_ERROR_PERCENT = (1.66, 4.16, 2.91, 2.50, 5.00)
# The one scene with a rest of flicker: the exposure is a nominal period of it.
FLICKERING = "anti_flicker"
RIGHT_WITHIN_STD = 3.0

Found = tuple[Record, dict[str, Any]]
_ZERO = """\

*: the flicker's alias at the frame rate is at 0 Hz, and the grid's drift turns it by a radian or
more; <1 rad: by less, too little to tell flicker from texture."""
_IDLE_NOTE = f"""\
Errors in percentage points of the frame period, over the clips that were estimated; est, amb, ref
and none count clips: estimated, ambiguous, refused, no signal. spread: rms of error over standard
error. bound: Cramér–Rao, uncoded. The paper, five cameras at 720p and 29.97 fps, 6 videos each:
average errors {min(PAPER_AVERAGE_ERROR_PERCENT)} to {max(PAPER_AVERAGE_ERROR_PERCENT):.2f}."""
_ENF_NOTE = """\
rms of a clip in mHz, against the grid's mean over the second around each value. usable: share of
the seconds with a value. spread: rms of error over standard error; >3σ: share of the values beyond
three. bound: Cramér–Rao of one second by itself, uncoded."""
_CLAIMS_NOTE = """\
Clips with nothing to claim. A claim is an idle ratio that was given, or one usable second of ENF.
below: the rate of claims that so few refute with 95 % confidence. right: claims within three
standard errors of the truth, where the exposure leaves some flicker; others: all but those."""


def _rows(
    records: Iterable[Record],
    by: Sequence[str],
    kind: str,
    row: Callable[[Sequence[Found]], dict[str, Any]],
) -> list[dict[str, Any]]:
    """Return a row for each cell, of clips with equal fields, coding and ``turned``, and method."""
    results = [
        {field: record[field] for field in by}
        | {"coding": coding, "turned": _turned(record), "method": method, "of": (record, result)}
        for record in records
        for coding, found in record["found"].items()
        for method, result in found[kind].items()
    ]
    rows = []
    for cell, group in grouped(results, *by, "coding", "turned", "method"):
        found = [one["of"] for one in group]
        cell |= {"kind": kind, "clips": len(found), "broke": sum("broke" in r for _, r in found)}
        used = [(r["cpu_s"], record["duration_s"]) for record, r in found if "cpu_s" in r]
        cpu_s, seconds = map(sum, zip(*used, strict=True)) if used else (0.0, 0.0)
        rows.append(cell | row(found) | {"cpu_ms_per_s": 1e3 * cpu_s / seconds if used else None})
    return rows


def _turned(record: Record) -> bool | None:
    """Whether an alias at 0 Hz turns by at least 1 rad; None of any other alias."""
    f0_hz, rate_hz = 2 * record["nominal_hz"], record["frames"] / record["duration_s"]
    alias_hz = abs(f0_hz - round(f0_hz / rate_hz) * rate_hz)
    if record["scene"] != LIT or alias_hz > ALIAS_ZERO_HZ:
        return None
    return bool(record["alias_turn_rad"] >= TURN_RAD)


def relative_errors(result: dict[str, Any]) -> FloatArray:
    """Return errors over their standard errors, if known, of ENF estimates or an idle ratio."""
    errors = result.get("error_mhz", [result.get("error_percent")])
    stds = result.get("std_mhz", [result.get("std_percent")])
    pairs = zip(errors, stds, strict=True)
    return np.array([e / s for e, s in pairs if e is not None and s], np.float64)


def estimated(results: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the results of idle methods that are an estimate."""
    said = (r for r in results if r.get("verdict") == "estimated")
    return [r for r in said if r["error_percent"] is not None]


def _idle_row(found: Sequence[Found]) -> dict[str, Any]:
    verdicts = Counter(r.get("verdict") for _, r in found)
    given = estimated(r for _, r in found)
    errors = [abs(r["error_percent"]) for r in given]
    return {
        **{verdict: verdicts[verdict] for verdict in VERDICTS},
        "median_percent": median(errors),
        "worst_percent": worst(errors),
        "std_percent": median([r["std_percent"] for r in given if r["std_percent"]]),
        "spread": rms([e for r in given for e in relative_errors(r).tolist()]),
        "bound_percent": median([record["idle_bound_percent"] for record, _ in found]),
    }


def _enf_row(found: Sequence[Found]) -> dict[str, Any]:
    """Return errors, mHz against the mean of a second; a clip's is the rms of its usable values."""
    results = [result for _, result in found]
    clips = [rms([e for e in r.get("error_mhz", ()) if e is not None]) for r in results]
    known = [error for error in clips if error is not None]
    relative = np.concatenate([relative_errors(result) for result in results])
    seconds = sum(record["duration_s"] for record, _ in found)
    return {
        "with_values": len(known),
        "usable_ratio": sum(len(r.get("t_s", ())) for r in results) / seconds,
        "median_mhz": median(known),
        "worst_mhz": worst(known),
        "std_mhz": median([s for r in results for s in r.get("std_mhz", ()) if s]),
        "spread": rms(relative.tolist()),
        "beyond_3_std_ratio": float(np.mean(np.abs(relative) > 3)) if relative.size else None,
        "bound_mhz": median([record["enf_bound_mhz"] for record, _ in found]),
    }


def _claims_row(found: Sequence[Found]) -> dict[str, Any]:
    claims = sum(_claimed(result) for _, result in found)
    # An exposure of one flicker period removes it only where the grid is at its nominal frequency.
    right = sum(_is_right(record, result) for record, result in found)
    return {
        "claims": claims, "bound_ratio": rate_bound(claims, len(found)), "right": right,
        "false_bound_ratio": rate_bound(claims - right, len(found)),
    }  # fmt: skip


def _claimed(result: dict[str, Any]) -> bool:
    """Whether a method gives an idle ratio, or at least one usable second of ENF."""
    claiming = result.get("verdict") in ("estimated", "ambiguous")
    return bool(result.get("t_s")) or (claiming and result["idle_percent"] is not None)


def _is_right(record: Record, result: dict[str, Any]) -> bool:
    if not _claimed(result) or record.get("of", record["scene"]) != FLICKERING:
        return False
    relative = relative_errors(result)
    return bool(relative.size and np.median(np.abs(relative)) <= RIGHT_WITHIN_STD)


def _tabulated(table: str, records: Sequence[Record], *, pooled: bool = False) -> dict[str, Any]:
    if table == "claims":
        every = [*records, *(r | {"of": r["scene"], "scene": "all"} for r in records)]
        rows = [r for of in ("idle", "enf") for r in _rows(every, ("scene",), of, _claims_row)]
    else:
        row = {"idle": _idle_row, "enf": _enf_row}[table]
        rows = _rows(records, POOLED if pooled else CELL, table, row)
    return {
        "table": table,
        "clips": len(records),
        **origin_of(records),
        "durations_s": sorted({record["duration_s"] for record in records}),
        "rows": rows,
    }


def _text(document: Row, *, on_page: bool = False) -> str:
    """Return a table for a terminal; in Markdown, methods have columns of median (maximum)."""
    rows, name = document["rows"], document["table"]
    columns, note = _TEXT[name]
    table = table_of("", columns, rows)
    if on_page and name in _BRIEF:
        bound, brief = _BRIEF[name]
        clip: tuple[Column, ...] = (
            ("clip", _cell), ("coding", "coding"), ("clips", "clips"), ("bound", bound, ".3g"),
        )  # fmt: skip
        table = by_method("", clip, brief, rows)
    seconds = "seconds each: " + ", ".join(f"{s:g}" for s in document["durations_s"])
    made = made_from(document, "clips", seconds, f"grid: {', '.join(document['grids'])}")
    made += _ZERO if any(row["turned"] is not None for row in rows) else ""
    notes = made if on_page else f"{note}\n{made}"
    return f"{written(table, on_page=on_page)}\n\n{notes}"


def _idle_brief(row: Row) -> str:
    others = [f"{row[v]} {v.replace('_', ' ')}" for v in (*VERDICTS[1:], "broke") if row[v]]
    given = row["median_percent"] is not None
    figures = f"{shown(row['median_percent'])} ({shown(row['worst_percent'])})" if given else ""
    return "; ".join(filter(None, (figures, ", ".join(others)))) or NONE


def _enf_brief(row: Row) -> str:
    if row["median_mhz"] is None:
        return NONE
    figures = f"{shown(row['median_mhz'])} ({shown(row['worst_mhz'])})"
    return f"{figures}, {shown(row['usable_ratio'], '.3g %')}"


def _cell(row: Row) -> str:
    size = f"{row['size']} " if "size" in row else ""
    zero = {None: "", True: "*", False: "*<1 rad"}[row["turned"]]
    return f"{size}{row['frame_rate']} fps {row['nominal_hz']:g} Hz{zero}"


_CLIPS: tuple[Column, ...] = (
    ("cell", _cell), ("coding", "coding"), ("method", "method"), ("clips", "clips"),
)  # fmt: skip
_IDLE: tuple[Column, ...] = (
    *_CLIPS, *zip(("est", "amb", "ref", "none", "broke"), (*VERDICTS, "broke"), strict=True),
    ("median", "median_percent", ".3g"), ("worst", "worst_percent", ".3g"),
    ("std", "std_percent", ".3g"), ("spread", "spread", ".3g"), ("bound", "bound_percent", ".3g"),
    ("ms/s", "cpu_ms_per_s", ".3g"),
)  # fmt: skip
_ENF: tuple[Column, ...] = (
    *_CLIPS, ("with", "with_values"), ("broke", "broke"), ("usable", "usable_ratio", ".3g %"),
    ("median", "median_mhz", ".3g"), ("worst", "worst_mhz", ".3g"), ("std", "std_mhz", ".3g"),
    ("spread", "spread", ".3g"), (">3σ", "beyond_3_std_ratio", ".3g %"),
    ("bound", "bound_mhz", ".3g"), ("ms/s", "cpu_ms_per_s", ".3g"),
)  # fmt: skip
_CLAIMS: tuple[Column, ...] = (
    ("scene", "scene"), ("coding", "coding"), ("of", "kind"), ("method", "method"),
    ("clips", "clips"), ("claims", "claims"), ("below", "bound_ratio", ".3g %"), ("right", "right"),
    ("others below", "false_bound_ratio", ".3g %"), ("broke", "broke"),
    ("ms/s", "cpu_ms_per_s", ".3g"),
)  # fmt: skip
_TEXT = {
    "idle": (_IDLE, _IDLE_NOTE), "enf": (_ENF, _ENF_NOTE), "claims": (_CLAIMS, _CLAIMS_NOTE),
}  # fmt: skip
_BRIEF = {"idle": ("bound_percent", _idle_brief), "enf": ("bound_mhz", _enf_brief)}


def clips_of(run: BenchRun) -> tuple[Plan, list[Record]]:
    """Measure the clips that are missing; return their plan and records."""
    plan: Plan = run.settings()
    claims = run.options.table == "claims"
    clips, file = (plan.nothing(), "claims.jsonl") if claims else (plan.lit(), "clips.jsonl")
    work = partial(measure_clip, grids=run.options.grids)
    return plan, run.records({c.key: (c,) for c in clips}, work, file, "clips")


def measure(run: BenchRun) -> Made:
    """Measure the clips that are missing, and tabulate all."""
    _, records = clips_of(run)
    options = run.options
    return Made(_tabulated(options.table, records, pooled=options.pool_sizes), _text)
