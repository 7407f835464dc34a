"""Records of trials to the rows of the tables: counts and rates, nothing left out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench.bounds import rate_bound
from rsenf.bench.plan import LOSSLESS
from rsenf.bench.recording_time.paper import (
    DEFAULT,
    FALSE_FROM_S,
    FALSE_PERCENT,
    MARKS,
)
from rsenf.bench.recording_time.references import PRESENT
from rsenf.bench.recording_time.search import PAPER_METRICS
from rsenf.bench.recording_time.trials import FALSE, NONE, TRUE

Row = dict[str, Any]

ALL = "all"
COMPRESSED = "compressed"
LONGER = f"≥{FALSE_FROM_S:g}"


def trials_of(records: Iterable[Record]) -> list[Row]:
    """Return all trials of records, each with what it was of."""
    return [
        {name: record[name] for name in ("kind", "coding", "length_s")} | trial
        for record in records
        for trial in record["trials"]
    ]


def cell_rows(trials: Sequence[Row]) -> list[Row]:
    """Return decisions by kind, coding, length and method, the true time present and absent."""
    return [
        cell | _decisions(found, lambda t: t["trial"] == PRESENT) | _absent(found)
        for cell, found in grouped(trials, "kind", "coding", "length_s", "method")
    ]


def absent_rows(trials: Sequence[Row]) -> list[Row]:
    """Return false decisions with the true time absent, of all kinds and codings together.

    By method and length, of all lengths, and of those that a mark is set for; each with the 95 %
    bound of its rate, which counts trials as independent: those of one film in one day aren't
    quite.
    """
    pooled = [t | {"length_s": ALL} for t in trials]
    longer = [t | {"length_s": LONGER} for t in trials if t["length_s"] >= FALSE_FROM_S]
    return [
        cell | _absent(found)
        for cell, found in grouped([*trials, *pooled, *longer], "length_s", "method")
    ]


def mark_rows(trials: Sequence[Row], absent: Sequence[Row]) -> list[Row]:
    """Return what the default method was to reach, what it did reach, and whether that is so."""
    rows = []
    for mark in MARKS:
        found = [
            t for t in trials
            if (t["method"], t["coding"], t["length_s"]) == (DEFAULT, mark.coding, mark.length_s)
        ]  # fmt: skip
        said = _decisions(found, lambda t: t["trial"] == PRESENT)
        rows.append({
            "mark": f"true, {mark.coding}, {mark.length_s:g} s, at least",
            "percent": mark.true_percent, "trials": said["present"],
            "found_percent": said["true_percent"],
            "reached": _least(said["true_percent"], mark.true_percent),
        })  # fmt: skip
    for row in absent:
        if (row["method"], row["length_s"]) == (DEFAULT, LONGER):
            rows.append({
                "mark": f"false, time absent, {FALSE_FROM_S:g} s and longer, at most",
                "percent": FALSE_PERCENT, "trials": row["absent"],
                "found_percent": row["absent_false_percent"],
                "reached": _least(FALSE_PERCENT, row["absent_false_percent"]),
            })  # fmt: skip
    return rows


def order_rows(trials: Sequence[Row]) -> list[Row]:
    """Return true decisions of Metrics 1 to 4, and whether each had at least those before it.

    By kind, whether the film had been compressed, as in the paper's tables, and length: each, and
    all together.
    """
    of_paper = [
        t | {"coded": LOSSLESS if t["coding"] == LOSSLESS else COMPRESSED, "length_s": length}
        for t in trials
        if t["method"] in PAPER_METRICS and t["trial"] == PRESENT
        for length in (t["length_s"], ALL)
    ]
    rows = []
    for cell, found in grouped(of_paper, "kind", "coded", "length_s"):
        counts = [_count(found, TRUE, method) for method in PAPER_METRICS]
        wrong = [_count(found, FALSE, method) for method in PAPER_METRICS]
        rows.append(
            cell
            | {"trials": sum(t["method"] == PAPER_METRICS[0] for t in found)}
            | {"true": counts, "false": wrong, "holds": counts == sorted(counts)}
        )
    return rows


def grouped(trials: Iterable[Row], *by: str) -> list[tuple[Row, list[Row]]]:
    """Return groups of trials that have the same values, in the order in which they first come."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for trial in trials:
        groups.setdefault(tuple(trial[name] for name in by), []).append(trial)
    return [(dict(zip(by, key, strict=True)), found) for key, found in groups.items()]


def _decisions(found: Sequence[Row], wanted: Callable[[Row], bool]) -> Row:
    trials = [t for t in found if wanted(t)]
    counts = {outcome: _count(trials, outcome) for outcome in (TRUE, FALSE, NONE)}
    rates = {f"{outcome}_percent": _percent(n, len(trials)) for outcome, n in counts.items()}
    return {"present": len(trials), **counts, **rates, "broke": sum("broke" in t for t in found)}


def _absent(found: Sequence[Row]) -> Row:
    trials = [t for t in found if t["trial"] != PRESENT]
    wrong = _count(trials, FALSE)
    return {
        "absent": len(trials),
        "absent_false": wrong,
        "absent_false_percent": _percent(wrong, len(trials)),
        "absent_bound_percent": 100 * rate_bound(wrong, len(trials)),
    }


def _count(trials: Sequence[Row], outcome: str, method: str = "") -> int:
    return sum(t.get("outcome") == outcome and method in ("", t["method"]) for t in trials)


def _percent(count: int, of: int) -> float | None:
    return 100 * count / of if of else None


def _least(value: float | None, limit: float | None) -> bool | None:
    """Whether a value is at least a limit; None where one isn't known."""
    return None if value is None or limit is None else value >= limit
