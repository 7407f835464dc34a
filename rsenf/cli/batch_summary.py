"""What 'rsenf batch' says: what is to be done, and what has become of it."""

from __future__ import annotations

import argparse
from collections import Counter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rsenf.batch.columns import Row
    from rsenf.batch.recordings import Found

_LISTED = 20  # of those without a result, or read in part


def plan_words(recordings: int, left: int, reasons: Counter[str], useless: int) -> str:
    """Say what is to be done, and why; and how many were of no use and haven't changed."""
    from rsenf.batch.plan import NEW

    again = [f"{number} {why}" for why, number in reasons.items() if why != NEW]
    why = f" ({', '.join([f'{reasons[NEW]} new', *again])})" if again else ""
    more = f"; unusable before, and unchanged: {useless} (--retry does them again)" * bool(useless)
    return f"recordings to do: {left} of {recordings}{why}{more}"


def summary_of(args: argparse.Namespace, found: Found, rows: Sequence[Row]) -> dict[str, Any]:
    """Return what a batch has come to, as JSON."""
    from rsenf.batch.columns import DONE, STATUSES
    from rsenf.batch.recordings import JOURNAL
    from rsenf.cli.batch import PAGE, TABLE

    statuses = Counter(row["status"] for row in rows)
    verdict = "decision" if args.analysis == "verify" else "verdict"
    verdicts = Counter(row[verdict] for row in rows if row["status"] == DONE and verdict in row)
    return {
        "version": 1,
        "analysis": args.analysis,
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
        "table": str(args.out / TABLE),
        "page": str(args.out / PAGE),
        "journal": str(args.out / JOURNAL),
    }


def print_summary(args: argparse.Namespace, summary: dict[str, Any]) -> None:
    """Print it, and say on stderr what to look at."""
    from rsenf.batch.columns import STATUSES
    from rsenf.cli.console import note, print_json, say

    if args.json:
        print_json(summary)
    else:
        counts = [f"{summary[s]} {s.replace('_', ' ')}" for s in STATUSES if summary[s]]
        print(f"{summary['recordings']} recordings: {', '.join(counts)}")
        if summary["verdicts"]:
            found = ", ".join(f"{number} {name}" for name, number in summary["verdicts"].items())
            print(f"  {'verdicts':10} {found}")
        for name in ("table", "page"):
            print(f"  {name:10} {summary[name]}")
    if summary["passed_over"]:
        kinds = ", ".join(f"{number} {kind}" for kind, number in summary["passed_over"].items())
        note(f"not named like recordings, passed over: {kinds}")
    if summary["named_again"]:
        note(f"found under another name too, done once: {summary['named_again']}")
    in_part = [f"read in part: {r['path']}: {r['loss']}" for r in summary["read_in_part"]]
    without = [f"{r['status']}: {r['path']}: {r['reason']}" for r in summary["without_result"]]
    for lines in (in_part, without):
        for line in lines[:_LISTED]:
            say(_one_line(line))
        if len(lines) > _LISTED:
            say(f"… and {len(lines) - _LISTED} more: see the table")
    for line in summary["unreadable_folders"]:
        say(f"folder not looked into: {_one_line(line)}")


def _one_line(text: str) -> str:
    """Write what would break a line, or do worse to a terminal, as Python writes it."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def exit_code(rows: Sequence[Row], found: Found) -> int:
    """Return 0 when all have a result, 3 when some have it with loss, 1 when some have none."""
    from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_LOSS

    if _without(rows) or found.unreadable:
        return EXIT_FAILED
    return EXIT_LOSS if any(row.get("loss") for row in rows) else EXIT_DONE


def _without(rows: Sequence[Row]) -> list[Row]:
    from rsenf.batch.columns import DONE, NO_SIGNAL

    return [row for row in rows if row["status"] not in (DONE, NO_SIGNAL)]
