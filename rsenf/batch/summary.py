"""The texts and the JSON of a batch: what is to be done, and its results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rsenf.batch.columns import DONE, NO_SIGNAL, STATUSES, Row
from rsenf.batch.plan import NEW
from rsenf.batch.recordings import JOURNAL, Found
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_LOSS

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
