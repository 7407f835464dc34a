"""The rows of the result table: their columns, which are left to do, and the summary."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from rsenf.batch.settings import JOURNAL, Found, RecordingFile
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_LOSS, UsageError

VERSION = 1  # changes when a column is removed or changes its meaning
Kind = Literal["text", "texts", "number", "count"]
Row = dict[str, Any]

DONE, NO_SIGNAL, UNUSABLE, FAILED = STATUSES = ("done", "no_signal", "unusable", "failed")

FIRST: dict[str, Kind] = {"path": "text", "status": "text", "reason": "text"}
LAST: dict[str, Kind] = {
    "warnings": "texts",
    "loss": "text",
    "recording_s": "number",
    "size_bytes": "count",
    "modified_utc": "text",
    "sha256": "text",
    "took_s": "number",
    "tries": "count",
    "host": "text",
    "rsenf_version": "text",
}
# Names as in the JSON of the command for one recording.
ANALYSES: dict[str, dict[str, Kind]] = {
    "verify": {
        "decision": "text",
        "grid": "text",
        "start_utc": "text",
        "lag_s": "number",
        "lag_std_s": "number",
        "correlation": "number",
        "log10_lr": "number",
        "log10_lr_absent": "number",
        "verbal": "text",
        "claim": "text",
        "claim_log10_lr": "number",
        "clock_ppm": "number",
        "clock_std_ppm": "number",
        "idle_ratio": "number",
        "search_size": "count",
        "seconds_used": "number",
        "method": "text",
    },
    "idle": {
        "verdict": "text",
        "idle_ratio": "number",
        "idle_ratio_std": "number",
        "idle_ratio_low": "number",
        "idle_ratio_high": "number",
        "read_out_time_s": "number",
        "read_out_time_std_s": "number",
        "direction": "text",
        "frame_rate_hz": "number",
        "nominal_hz": "number",
        "method": "text",
    },
    "track": {
        "values": "count",
        "usable_values": "count",
        "enf_mean_hz": "number",
        "enf_mean_std_hz": "number",
        "enf_min_hz": "number",
        "enf_max_hz": "number",
        "enf_std_median_hz": "number",
        "snr_median_db": "number",
        "nominal_hz": "number",
        "harmonic": "count",
        "line_hz": "number",
        "frame_rate_hz": "number",
        "enf_file": "text",
    },
    "discover": {
        "verdict": "text",
        "effects": "texts",
        "gap_before": "number",
        "gap_before_stderr": "number",
        "gap_after": "number",
        "gap_stderr": "number",
        "gap_floor": "number",
        "gap_limit": "number",
        "shrinkage": "number",
        "unexplained": "text",
        "camera": "text",
        "report": "text",
    },
}


def columns_of(analysis: str) -> dict[str, Kind]:
    """Return the columns of an analysis's table, in order."""
    return FIRST | ANALYSES[analysis] | LAST


def make_row(
    recording: RecordingFile, analysis: str, settings: str, status: str, reason: str, **more: Any
) -> Row:
    """Return the journal's row of a recording.

    Parameters
    ----------
    recording : RecordingFile
    analysis : str
    settings : str
        Fingerprint of everything else that the result depends on.
    status : str
        One of ``STATUSES``.
    reason : str
        Why there is no result, or only a negative one.
    **more
        Other columns; those not given are unknown.
    """
    return {
        "version": VERSION,
        "key": recording.key,
        "analysis": analysis,
        "settings": settings,
        "size_bytes": recording.size_bytes,
        "modified_ns": recording.modified_ns,
        "path": recording.path,
        "status": status,
        "reason": reason,
        **more,
    }


NEW, CHANGED, OTHER, TRIED = "new", "changed since", "done with other settings", "without a result"
DAMAGED = "of which the journal is damaged"


def check_analysis(analysis: str, rows: Iterable[Row], out: Path) -> None:
    """Refuse to replace the results of another analysis.

    Raises
    ------
    UsageError
        If there are any.
    """
    others = {str(row.get("analysis")) for row in rows} - {analysis}
    if others:
        problem = f"--out {out}: holds results of '{min(others)}'"
        raise UsageError(problem, f"name another folder for those of '{analysis}'")


def left_to_do(
    recordings: Iterable[RecordingFile], rows: Mapping[str, Row], settings: str, *, retry: bool
) -> tuple[list[RecordingFile], Counter[str]]:
    """Return the recordings to do, and their number by reason.

    A recording that was read completely and is unusable is skipped until it changes; one that could
    not be read, or failed, is tried again.

    Parameters
    ----------
    recordings : iterable of RecordingFile
    rows : mapping of dict
        Rows of the journal, by the key of the recording.
    settings : str
        Fingerprint of everything else that results depend on.
    retry : bool
        Whether to do unusable recordings again, too.
    """
    pending, reasons = [], Counter[str]()
    for recording in recordings:
        reason = _why(recording, rows.get(recording.key), settings, retry)
        if reason:
            pending.append(recording)
            reasons[reason] += 1
    return pending, reasons


def _why(recording: RecordingFile, row: Row | None, settings: str, retry: bool) -> str:
    """Return the reason to do a recording; empty if it is done."""
    if row is None:
        return NEW
    if (row.get("version"), row.get("settings")) != (VERSION, settings):
        return OTHER
    known = row.get("size_bytes"), row.get("modified_ns")
    if known != (recording.size_bytes, recording.modified_ns):
        return CHANGED
    if not _is_sound(row):
        return DAMAGED
    settled = row["status"] in (DONE, NO_SIGNAL) or (is_useless(row) and not retry)
    return "" if settled else TRIED


def _is_sound(row: Row) -> bool:
    """Whether every column holds what it can hold."""
    path, columns, model = row.get("path"), columns_of(row["analysis"]), row.get("model")
    return (
        row.get("status") in STATUSES
        and isinstance(path, str)
        and Path(path).is_absolute()
        and all(_holds(kind, row.get(name)) for name, kind in columns.items())
        and (model is None or (isinstance(model, dict) and model.keys() == _OF_CAMERA))
    )


_OF_CAMERA = {"shutter", "sensor", "effects", "provenance"}  # parts of a discovered model


def _holds(kind: Kind, value: Any) -> bool:
    if kind == "texts" and isinstance(value, list):
        return all(isinstance(line, str) for line in value)
    if kind == "text" or value is None:
        return isinstance(value, str | None)
    if isinstance(value, float):
        return kind == "number" and math.isfinite(value)
    return type(value) is int and kind in ("number", "count") and abs(value) < 2**53


def is_useless(row: Row) -> bool:
    """Whether a recording was read completely and is unusable."""
    return row["status"] == UNUSABLE and row.get("sha256") is not None


TABLE, PAGE = "batch.parquet", "batch.html"
_LISTED = 20  # most lines for recordings without a result, and for those read in part


def plan_words(recordings: int, remaining: int, reasons: Counter[str], useless: int) -> str:
    """Describe what is to be done and why, and how many unusable recordings are unchanged."""
    again = [f"{number} {why}" for why, number in reasons.items() if why != NEW]
    why = f" ({', '.join([f'{reasons[NEW]} new', *again])})" if again else ""
    more = f"; unusable before, and unchanged: {useless} (--retry does them again)" * bool(useless)
    return f"recordings to do: {remaining} of {recordings}{why}{more}"


def summary_of(analysis: str, out: Path, found: Found, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the results of a batch as JSON."""
    statuses = Counter(row["status"] for row in rows)
    verdict = "decision" if analysis == "verify" else "verdict"
    verdicts = Counter(row[verdict] for row in rows if row["status"] == DONE and verdict in row)
    return {
        "version": 1,
        "analysis": analysis,
        "recordings": len(rows),
        **{status: statuses[status] for status in STATUSES},
        "verdicts": dict(verdicts.most_common()),
        "without_result": [
            {name: row[name] for name in ("path", "status", "reason")} for row in _without(rows)
        ],
        "read_in_part": [
            {name: row[name] for name in ("path", "loss")} for row in rows if row.get("loss")
        ],
        "passed_over": dict(found.passed_over.most_common()),
        "named_again": found.again,
        "unreadable_folders": found.unreadable,
        "table": str(out / TABLE),
        "page": str(out / PAGE),
        "journal": str(out / JOURNAL),
    }


def summary_words(summary: dict[str, Any]) -> str:
    """Return the summary as text."""
    counts = [f"{summary[s]} {s.replace('_', ' ')}" for s in STATUSES if summary[s]]
    lines = [f"{summary['recordings']} recordings: {', '.join(counts)}"]
    if summary["verdicts"]:
        found = ", ".join(f"{number} {name}" for name, number in summary["verdicts"].items())
        lines.append(f"  {'verdicts':10} {found}")
    camera = summary.get("camera", {})
    if camera.get("model"):
        lines += [f"  {'camera':10} {camera['model']}, of {camera['recordings']} recordings"]
        lines += [
            f"  {'':10} {name} {one['mean']:.6g} ± {one['stderr']:.2g}, spread {one['spread']:.2g}"
            for name, one in camera["common"].items()
        ]
        lines += [f"  {'':10} in {n}: {name}" for name, n in camera["other_effects"].items()]
    return "\n".join([*lines, *(f"  {name:10} {summary[name]}" for name in ("table", "page"))])


def troubles(summary: dict[str, Any]) -> list[str]:
    """Return the problems, one line each."""
    in_part = [f"read in part: {r['path']}: {r['loss']}" for r in summary["read_in_part"]]
    without = [f"{r['status']}: {r['path']}: {r['reason']}" for r in summary["without_result"]]
    said = []
    for lines in (in_part, without):
        said += [_one_line(line) for line in lines[:_LISTED]]
        if len(lines) > _LISTED:
            said.append(f"… and {len(lines) - _LISTED} more: see the table")
    unreadable = summary["unreadable_folders"]
    return [*said, *(f"folder not looked into: {_one_line(line)}" for line in unreadable)]


def _one_line(text: str) -> str:
    """Escape characters that would break a line or affect a terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def exit_code(rows: Sequence[Row], found: Found) -> int:
    """Return 0 if all have a result, 3 if some have one with loss, 1 if some have none."""
    if _without(rows) or found.unreadable:
        return EXIT_FAILED
    return EXIT_LOSS if any(row.get("loss") for row in rows) else EXIT_DONE


def _without(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row["status"] not in (DONE, NO_SIGNAL)]
