"""Records of blind discovery to rates and the confusion matrix; of a foreign camera, to marks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.discover import KINDS
from rsenf.bench.discover.beside import clock_rows
from rsenf.bench.discover.foreign import KINDS as FOREIGN_KINDS
from rsenf.bench.discover.judge import HALF, LEFT, MISSED, REST, RIGHT, UNSEEN, WRONG
from rsenf.bench.tables import (
    SOME,
    Column,
    Table,
    mean,
    median,
    percent,
    picture,
    table_of,
    titled,
    written,
)

Record = dict[str, Any]
NOTHING, MORE = "nothing", "a rest"  # answers without a name


def tabulated(records: Sequence[Record]) -> dict[str, Any]:
    """Return rates and the confusion matrix as plain values."""
    rows = []
    for depth in (False, True):
        for kind in KINDS:
            of_kind = [r for r in records if r["kind"] == kind and r["video"] == depth]
            if kind in ("one", "outside"):
                for name in dict.fromkeys(r["hidden"][0] for r in of_kind):
                    rows.append(_row(name, [r for r in of_kind if r["hidden"] == [name]]))
            if of_kind:
                whole = {"one": "all single effects", "none": "nothing hidden",
                         "outside": "all outside", "pair": "pairs"}[kind]  # fmt: skip
                rows.append(_row(whole, of_kind))
    rows += [_row(name, cases) for name, cases in clock_rows(records).items()]
    return {"cases": len(records), "rows": rows, "named": named(records)}


def named(records: Sequence[Record]) -> dict[str, dict[str, int]]:
    """Count named effects by hidden effect, of cases with at most one."""
    out: dict[str, Counter[str]] = {}
    for record in records:
        if record["kind"] == "pair":
            continue
        hidden = (record["hidden"] or [NOTHING])[0]
        answers = record["named"] or [MORE if record["verdict"] == "unexplained" else NOTHING]
        out.setdefault(hidden, Counter()).update(answers)
    return {name: dict(counts) for name, counts in out.items()}


def rates(name: str, records: Sequence[Record]) -> dict[str, Any]:
    """Return counts of outcomes and errors of parameters of some cases.

    Parameters
    ----------
    name : str
        Of the row.
    records : sequence of dict
        At least one.
    """
    outcome = Counter(r["outcome"] for r in records)
    sure = [abs(e) for r in records for e in r["error_over_stderr"].values() if e is not None]
    return {
        "hidden": name,
        "times": records[0]["times"],
        "cases": len(records),
        "right": outcome[RIGHT],
        "rest": outcome[REST] + outcome[LEFT],
        "wrong": outcome[WRONG],
        "missed": outcome[MISSED],
        "unexplained": sum(r["verdict"] == "unexplained" for r in records),
        "refused": sum(r["verdict"] == "refused" for r in records),
        "named": mean([r["outcome"] in (RIGHT, REST) for r in records if r["outcome"] != UNSEEN]),
        "error_median": median([error for r in records for error in errors_of(r)]),
        "within_two": mean([e <= 2.0 for e in sure]),
        "cpu_median_s": median([r["cpu_s"] for r in records]),
    }


def errors_of(record: Record) -> list[float]:
    """Return the largest relative error of a parameter for each effect with an estimate."""
    worst: dict[str, float] = {}
    for key, error in record["relative_error"].items():
        if error is not None:
            effect = key.partition(".")[0]
            worst[effect] = max(worst.get(effect, 0.0), abs(error))
    return list(worst.values())


def _row(name: str, records: Sequence[Record]) -> dict[str, Any]:
    shrinkage = [
        r["gap"]["shrinkage"]
        for r in records
        if r["verdict"] == "explained" and r["gap"].get("shrinkage") is not None
    ]
    return rates(name, records) | {
        "video": records[0]["video"],
        "shrinkage_median": median(shrinkage),
        "shrinkage_least": min(shrinkage, default=None),
        "given_back": sum(bool(r.get("given_back")) for r in records),
        "given_back_lack_nothing": sum(r.get("given_back") == "no_discrepancy" for r in records),
    }


_COLUMNS: tuple[Column, ...] = (
    ("hidden", lambda r: ("video: " if r["video"] else "") + str(r["hidden"])),
    ("cases", "cases"), ("right", "right"), ("and a rest", "rest"), ("wrong", "wrong"),
    ("missed", "missed"), ("rightly named", "named", ".0f %"),
    ("size off by", "error_median", ".1f %"), ("within 2 std", "within_two", ".1f %"),
    ("gap closed, median", "shrinkage_median", ".2f %"), ("least", "shrinkage_least", ".1f %"),
    (
        "model lacks nothing",
        lambda r: f"{r['given_back_lack_nothing']}/{r['given_back']}" if r["given_back"] else "–",
    ),
    ("CPU", "cpu_median_s", ".1f s"),
)  # fmt: skip


def text(document: dict[str, Any], *, on_page: bool = False) -> str:
    """Write the table for a terminal, or in Markdown for a page."""
    return written(table_of("", _COLUMNS, document["rows"]), on_page=on_page)


def draw(path: Path, document: dict[str, Any]) -> None:
    """Draw the confusion matrix into a PNG file."""
    counts = document["named"]
    hidden = sorted(counts)
    answers = sorted({name for answers_of in counts.values() for name in answers_of})
    table = np.array([[counts[h].get(s, 0) for s in answers] for h in hidden], float)
    size = (2.5 + 0.42 * len(answers), 2.5 + 0.32 * len(hidden))
    with picture(path, size) as figure:
        axes = figure.subplots()
        share = table / np.maximum(table.sum(axis=1, keepdims=True), 1.0)
        axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        for row, column in zip(*np.nonzero(table), strict=True):
            dark = share[row, column] > 0.5
            axes.text(
                column, row, f"{table[row, column]:.0f}", ha="center", va="center",
                color="white" if dark else "black", fontsize="small",
            )  # fmt: skip
        axes.set_xticks(range(len(answers)), answers, rotation=60, ha="right", fontsize="small")
        axes.set_yticks(range(len(hidden)), hidden, fontsize="small")
        axes.set_xlabel("named")
        axes.set_ylabel("hidden")


WHOLE = {
    "one": "all single effects", "none": "nothing hidden", "pair": "pairs", "triple": "triples",
    "unknown": "in no catalogue", "physical": "physical programs",
}  # fmt: skip
CLOSE = 0.05  # relative error of a size
Summary = Callable[[Sequence[float]], float | None]


def foreign_tabulated(records: Sequence[Record]) -> dict[str, Any]:
    """Return rates, limits and the confusion matrix as plain values."""
    rows = []
    for kind in FOREIGN_KINDS:
        of_kind = [r for r in records if r["kind"] == kind]
        if kind in ("one", "none", "unknown", "physical"):
            names = sorted({_what(r) for r in of_kind})
            for name in names if len(names) > 1 or kind != "none" else ():
                rows.append(_foreign_row(name, [r for r in of_kind if _what(r) == name]))
        if of_kind:
            rows.append(_foreign_row(WHOLE[kind], of_kind))
    wrong: dict[str, Counter[str]] = {}
    for record in records:
        if record["wrong_names"]:
            wrong.setdefault(_what(record), Counter()).update(record["wrong_names"])
    few = [r for r in records if len(r["hidden"]) < 2]
    return {
        "cases": len(records),
        "rows": rows,
        "named": named(few),
        "named_wrongly": {name: dict(counts) for name, counts in sorted(wrong.items())},
        "marks": marks(records),
    }


def marks(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Compare rates with their limits.

    The gap is of cases with an effect of the catalogue. The workflow starts from a lamp without
    harmonics, whose addition may close nearly all of it; so the share closed by the other effects
    is given as well.

    Parameters
    ----------
    records : sequence of dict
    """
    by_kind = {kind: [r for r in records if r["kind"] == kind] for kind in FOREIGN_KINDS}
    hidden = [r for kind in ("one", "pair", "triple") for r in by_kind[kind]]
    described = [r for r in by_kind["physical"] if r["outcome"] != UNSEEN]
    off = [error for r in hidden for error in errors_of(r)]
    closed = [r["closed"] for r in hidden if r["closed"] is not None]
    beside = [r["closed_beside"] for r in hidden if r["closed_beside"] is not None]
    names = [float(bool(r["wrong_names"])) for r in records]
    asked: list[tuple[str, bool, float, Summary, Sequence[float]]] = [
        ("nothing hidden: right", True, 0.95, mean, _are(by_kind["none"], RIGHT)),
        ("single: right name or class", True, 0.9, mean, _are(by_kind["one"], RIGHT, REST)),
        ("pairs: both named", True, 0.75, mean, _are(by_kind["pair"], RIGHT, REST)),
        ("cases with a wrong name", False, 0.02, mean, names),
        ("in no catalogue: right", True, 0.95, mean, _are(by_kind["unknown"], RIGHT)),
        ("physical programs: described rightly", True, 0.7, mean, _are(described, RIGHT)),
        ("physical programs: described wrongly", False, 0.02, mean, _are(described, WRONG)),
        ("gap above the floor closed, median", True, 0.9, median, closed),
        ("beside the lamp's harmonics, median", True, 0.9, median, beside),
        ("size off by, median", False, CLOSE, median, off),
    ]
    out: list[dict[str, Any]] = []
    for mark, least, limit, summary, values in asked:
        value = summary(values)
        reached = None if value is None else value >= limit if least else value <= limit
        out.append(
            {"mark": mark, "asked": limit, "at_least": least, "value": value,
             "cases": len(values), "reached": reached}
        )  # fmt: skip
    near = mean([error <= CLOSE for error in off])
    close = {"mark": "size within 5 %", "asked": None, "at_least": True, "value": near}
    return [*out, {**close, "cases": len(off), "reached": None}]


def foreign_text(document: dict[str, Any], *, on_page: bool = False) -> str:
    """Write the tables for a terminal, or in Markdown for a page."""
    wrong = [
        [hidden, ", ".join(f"{name} ×{n}" if n > 1 else name for name, n in names.items())]
        for hidden, names in document["named_wrongly"].items()
    ]
    reached = {True: "yes", False: "no", None: ""}
    marks: list[Column] = [
        ("mark", "mark"), ("asked", _asked), ("is", "value", ".1f %"), ("cases", "cases"),
        ("reached", lambda mark: reached[mark["reached"]]),
    ]  # fmt: skip
    tables: list[Table] = [
        table_of("cases", _FOREIGN_COLUMNS, document["rows"]),
        ("named wrongly", ("hidden", "named"), wrong),
        table_of("marks", marks, document["marks"]),
    ]
    return titled(tables, [_NOTE], on_page=on_page)


_NOTE = """\
a lamp's own harmonics are no wrong name. by a like name: an effect that does nearly the same was
named instead. size off by: the worse of size and frequency; of lost and doubled frames the share
that isn't told or is told wrongly. beside: of the gap that the lamp's harmonics don't close."""


def _what(record: Record) -> str:
    names = " + ".join(record["hidden"])
    if record["kind"] == "none":
        return f"{NOTHING} but {names}" if names else NOTHING
    return names


def _are(records: Sequence[Record], *outcomes: str) -> list[float]:
    """Return 1 for each record with one of the outcomes, 0 for the others."""
    return [float(r["outcome"] in outcomes) for r in records]


def _foreign_row(name: str, records: Sequence[Record]) -> dict[str, Any]:
    off = [error for r in records for error in errors_of(r)]
    closed = [r["closed"] for r in records if r["closed"] is not None]
    return rates(name, records) | {
        "kind": records[0]["kind"],
        "half": sum(r["outcome"] == HALF for r in records),
        "wrong_names": sum(bool(r["wrong_names"]) for r in records),
        "by_like": sum(bool(r["by_like"]) for r in records),
        "error_close": mean([error <= CLOSE for error in off]),
        "given_back": sum(bool(r.get("given_back")) for r in records),
        "given_back_lack_nothing": sum(r.get("given_back") == "no_discrepancy" for r in records),
        "closed_median": median(closed),
        "closed_least": min(closed, default=None),
        "beside_median": median(
            [r["closed_beside"] for r in records if r["closed_beside"] is not None]
        ),
        "idle_error_median": median(
            [abs(r["idle_error"]) for r in records if r["idle_error"] is not None]
        ),
    }


_FOREIGN_COLUMNS: tuple[Column, ...] = (
    ("hidden", "hidden"), ("cases", "cases"), ("right", "right"), ("and a rest", "rest"),
    ("half", "half", SOME), ("wrong", "wrong"), ("missed", "missed"), ("refused", "refused", SOME),
    ("with wrong names", "wrong_names", SOME), ("rightly", "named", ".0f %"),
    ("by a like name", "by_like", SOME), ("size off by", "error_median", ".1f %"),
    ("within 5 %", "error_close", ".0f %"), ("within 2 std", "within_two", ".0f %"),
    ("gap closed, median", "closed_median", ".2f %"), ("least", "closed_least", ".1f %"),
    ("beside", "beside_median", ".1f %"), ("idle off by", "idle_error_median", ".2f %"),
    (
        "model lacks nothing",
        lambda r: f"{r['given_back_lack_nothing']}/{r['given_back']}" if r["given_back"] else "",
    ),
    ("CPU", "cpu_median_s", ".1f s"),
)  # fmt: skip


def _asked(mark: dict[str, Any]) -> str:
    if mark["asked"] is None:
        return ""
    return f"{'≥' if mark['at_least'] else '≤'} {percent(mark['asked'], '.0f')}"
