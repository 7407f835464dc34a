"""Records of trials to the tables: decisions, errors, likelihood ratios, the paper's figures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.plan import LOSSLESS
from rsenf.bench.recording_time import MOVING, STILL
from rsenf.bench.recording_time.films import PRESENT
from rsenf.bench.recording_time.trials import FALSE, METHODS, NONE, PAPER_METRICS, TRUE
from rsenf.bench.tables import NONE as DASH
from rsenf.bench.tables import (
    Column,
    Row,
    Table,
    grouped,
    made_from,
    median,
    percent,
    rate_bound,
    rms,
    shown,
    table_of,
    titled,
    versions_of,
)

# The paper's tables of decisions by Metrics 1 to 4, per cent; the others are none.
PUBLISHED: tuple[Row, ...] = tuple(
    dict(zip(("kind", "videos", "coded", "true", "false"), row, strict=True))
    for row in (
        (STILL, 12, False, (100.0,) * 4, (0.0,) * 4),
        (STILL, 48, True, (45.83, 56.25, 68.75, 70.83), (0.0, 4.17, 4.17, 2.08)),
        (MOVING, 24, True, (62.5, 75.0, 79.16, 83.33), (8.33, 8.33, 12.5, 8.33)),
    )
)


DEFAULT = "phase"
# Least share of true decisions by coding and length (s), per cent, of all kinds of films together.
MARKS = ((LOSSLESS, 60.0, 95.0), ("50k", 120.0, 90.0))
# Largest share of false decisions with the true time absent, of clips of a least length.
FALSE_PERCENT, FALSE_FROM_S = 1.0, 120.0


ALL = "all"
COMPRESSED = "compressed"
LONGER = f"≥{FALSE_FROM_S:g}"


def trials_of(records: Iterable[Record]) -> list[Row]:
    """Return all trials of records, each with kind, coding and length."""
    return [
        {name: record[name] for name in ("kind", "coding", "length_s")} | trial
        for record in records
        for trial in record["trials"]
    ]


def cell_rows(trials: Sequence[Row]) -> list[Row]:
    """Return decisions by kind, coding, length and method, the true time present and absent."""
    return [
        cell | _decisions(found) | _absent(found)
        for cell, found in grouped(trials, "kind", "coding", "length_s", "method")
    ]


def absent_rows(trials: Sequence[Row]) -> list[Row]:
    """Return false decisions with the true time absent, of all kinds and codings together.

    By method and length, of all lengths, and of those with a limit; with the 95 % bound of the rate
    for independent trials, which those of one film on one day aren't quite.
    """
    pooled = [t | {"length_s": ALL} for t in trials]
    longer = [t | {"length_s": LONGER} for t in trials if t["length_s"] >= FALSE_FROM_S]
    return [
        cell | _absent(found)
        for cell, found in grouped([*trials, *pooled, *longer], "length_s", "method")
    ]


def mark_rows(trials: Sequence[Row], absent: Sequence[Row]) -> list[Row]:
    """Return limits of the default method, its results, and whether they are within."""
    rows = []
    for coding, length_s, true_percent in MARKS:
        found = [
            t for t in trials
            if (t["method"], t["coding"], t["length_s"]) == (DEFAULT, coding, length_s)
        ]  # fmt: skip
        decisions = _decisions(found)
        rows.append({
            "mark": f"true, {coding}, {length_s:g} s, at least",
            "percent": true_percent, "trials": decisions["present"],
            "found_percent": decisions["true_percent"],
            "reached": _least(decisions["true_percent"], true_percent),
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
    """Return true decisions of Metrics 1 to 4, and whether their numbers are in ascending order.

    By kind, compression as in the paper's tables, and length, also all lengths together.
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


def _decisions(found: Sequence[Row]) -> Row:
    trials = [t for t in found if t["trial"] == PRESENT]
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
    """Whether a value is at least a limit; None if one is unknown."""
    return None if value is None or limit is None else value >= limit


WITHIN_STD = 2.0
# Edges of the bins of log10 likelihood ratios; the outer bins are open.
EDGES = (-2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
RATIOS = {"other": "log10_lr", "absent": "log10_lr_absent"}


def recovery_rows(trials: Sequence[Row]) -> list[Row]:
    """Return errors of lag and clock of the true decisions, and their standard errors."""
    right = [t for t in trials if t.get("outcome") == TRUE]
    return [
        cell | {"trials": len(found)} | _errors(found, "lag", "s") | _errors(found, "clock", "ppm")
        for cell, found in grouped(right, "coding", "length_s", "method")
    ]


def _errors(found: Sequence[Row], what: str, unit: str) -> dict[str, Any]:
    pairs = [(t[f"{what}_error_{unit}"], t[f"{what}_std_{unit}"]) for t in found]
    known = [(e, s) for e, s in pairs if e is not None and s]
    within = [abs(e) <= WITHIN_STD * s for e, s in known]
    return {
        f"{what}_rms_{unit}": rms([e for e, _ in pairs if e is not None]),
        f"{what}_std_{unit}": median([s for _, s in known]),
        f"{what}_within": sum(within) / len(within) if within else None,
    }


def evidence_rows(trials: Sequence[Row]) -> list[Row]:
    """Return how often the best time is the true one, by its likelihood ratio.

    ``other``: against another time in the reference, of trials with the true one. ``absent``:
    against a time outside the reference, of all trials.
    """
    rows = []
    for question, name in RATIOS.items():
        asked = [
            t | {"question": question, "bin": int(np.digitize(t[name], EDGES))}
            for t in trials
            if t.get(name) is not None and (question == "absent" or t["trial"] == PRESENT)
        ]
        asked.sort(key=lambda t: (t["method"], t["bin"]))
        rows += [
            {"method": cell["method"], "question": question}
            | _edges(cell["bin"])
            | {"trials": len(found), "right": sum(t["nearest"] for t in found)}
            for cell, found in grouped(asked, "method", "bin")
        ]
    return rows


def _edges(number: int) -> dict[str, float | None]:
    edges = (None, *EDGES, None)
    return {"from": edges[number], "to": edges[number + 1]}


def tabulated(records: Sequence[Record]) -> Row:
    """Return the tables as plain values, with the films and versions behind them.

    Parameters
    ----------
    records : sequence of dict
        Of :func:`rsenf.bench.recording_time.trials.run_trials`.
    """
    trials = trials_of(records)
    absent = absent_rows(trials)
    return {
        "table": "recording-time",
        "films": len({(r["kind"], r["seed"]) for r in records}),
        "seeds": sorted({r["seed"] for r in records}),
        "grids": sorted({r["grid"] for r in records}),
        "references_h": sorted({r["reference_s"] / 3600 for r in records}),
        "noise_mhz": sorted({r["noise_mhz"] for r in records}),
        "versions": versions_of(records),
        "rows": cell_rows(trials),
        "absent": absent,
        "marks": mark_rows(trials, absent),
        "order": order_rows(trials),
        "recovery": recovery_rows(trials),
        "evidence": evidence_rows(trials),
        "published": list(PUBLISHED),
    }


_NOTE = """\
TD/FD/ND: decisions that are true (within 1 s), false, and none, per cent of the trials.
absent: the day of the film without 10 minutes on either side of it, and a day of another year;
any match there is false. bound: the rate that so few refute with 95 % confidence, were the trials
independent; those of one film aren't quite. Clips are cut from films that were encoded whole."""


def text(document: Row, *, on_page: bool = False) -> str:
    """Return the tables of :func:`rsenf.bench.recording_time.table.tabulated`."""
    made = made_from(
        document,
        "films",
        f"grid: {', '.join(document['grids'])}",
        "reference: " + ", ".join(f"{h:g} h" for h in document["references_h"]),
        "its noise: " + ", ".join(f"{n:g} mHz" for n in document["noise_mhz"]),
    )
    return titled(_tables(document), [_NOTE, made], on_page=on_page)


def _tables(document: Row) -> Iterator[Table]:
    yield _decision_table(document["rows"], document["published"])
    order = document["order"]
    held = f"in order in {sum(row['holds'] for row in order)} of {len(order)} cells"
    absent = "False decisions with the true time absent, all films and codings"
    yield table_of(absent, _FALSE, document["absent"])
    yield table_of("Marks of the default method", _MARKS, document["marks"])
    yield table_of(f"True decisions of Metrics 1 to 4: {held}", _ORDER, order)
    yield table_of("Lag and clock error of the true decisions", _RECOVERY, document["recovery"])
    yield table_of("What a likelihood ratio was worth", _EVIDENCE, document["evidence"])


def _decision_table(rows: Sequence[Row], published: Sequence[Row]) -> Table:
    """Return decisions, a line for each cell, a column for each method; and the paper's."""
    methods = [m for m in METHODS if any(row["method"] == m for row in rows)]
    cells: dict[tuple[str, str, float], dict[str, Row]] = {}
    for row in rows:
        cells.setdefault((row["kind"], row["coding"], row["length_s"]), {})[row["method"]] = row
    lines = [
        [kind, coding, f"{length_s:g} s", str(next(iter(of.values()))["present"])]
        + [_decided(of[m]) if m in of else DASH for m in methods]
        for (kind, coding, length_s), of in cells.items()
    ]
    if set(methods) & set(PAPER_METRICS):
        lines += [_as_published(p, methods) for p in published]
    head = ("film", "coding", "clip", "trials", *methods)
    return "TD/FD/ND with the true time in the reference", head, lines


def _decided(row: Row) -> str:
    broke = f" {row['broke']} broke" if row["broke"] else ""
    return "/".join(f"{row[f'{o}_percent']:.0f}" for o in ("true", "false", "none")) + broke


def _as_published(published: Row, methods: Sequence[str]) -> list[str]:
    figures = dict(
        zip(PAPER_METRICS, zip(published["true"], published["false"], strict=True), strict=True)
    )
    coding = "the paper's, coded" if published["coded"] else "the paper's originals"
    return [published["kind"], coding, "", str(published["videos"])] + [
        f"{figures[m][0]:.0f}/{figures[m][1]:.0f}/{100 - sum(figures[m]):.0f}"
        if m in figures
        else DASH
        for m in methods
    ]


def _length(row: Row) -> str:
    value = row["length_s"]
    return value if isinstance(value, str) else f"{value:g} s"


def _edge(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


_REACHED = {True: "yes", False: "no", None: DASH}
_FALSE: tuple[Column, ...] = (
    ("clip", _length), ("method", "method"), ("absent", "absent"), ("false", "absent_false"),
    ("rate", lambda r: shown(r["absent_false_percent"], unit=" %")),
    ("bound", lambda r: shown(r["absent_bound_percent"], unit=" %")),
)  # fmt: skip
_MARKS: tuple[Column, ...] = (
    ("mark", "mark"), ("limit", lambda r: shown(r["percent"], unit=" %")), ("trials", "trials"),
    ("found", lambda r: shown(r["found_percent"], unit=" %")),
    ("reached", lambda r: _REACHED[r["reached"]]),
)  # fmt: skip
_ORDER: tuple[Column, ...] = (
    ("film", "kind"), ("coding", "coded"), ("clip", _length), ("trials", "trials"),
    *((name, lambda r, n=n: str(r["true"][n])) for n, name in enumerate(PAPER_METRICS)),
    ("false", lambda r: "/".join(map(str, r["false"]))),
    ("each ≥ those before", lambda r: _REACHED[r["holds"]]),
)  # fmt: skip
_RECOVERY: tuple[Column, ...] = (
    ("coding", "coding"), ("clip", _length), ("method", "method"), ("true", "trials"),
    ("lag rms s", "lag_rms_s", ".3g"), ("said", "lag_std_s", ".3g"),
    ("within 2 std", "lag_within", ".0f %"), ("clock rms ppm", "clock_rms_ppm", ".3g"),
    ("said", "clock_std_ppm", ".3g"), ("within 2 std", "clock_within", ".0f %"),
)  # fmt: skip
_EVIDENCE: tuple[Column, ...] = (
    ("method", "method"), ("against", "question"), ("log10 LR from", lambda r: _edge(r["from"])),
    ("to", lambda r: _edge(r["to"])), ("trials", "trials"), ("best is true", "right"),
    ("share", lambda r: percent(r["right"] / r["trials"], ".0f")),
)  # fmt: skip
