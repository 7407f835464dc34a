"""Records of a foreign camera to rates, and to the marks that the workflow is to reach."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from rsenf.bench.discover.foreign import KINDS
from rsenf.bench.discover.judge import HALF, LEFT, MISSED, REST, RIGHT, WRONG
from rsenf.bench.discover.table import NOTHING, Record, named
from rsenf.bench.tables import titled

WHOLE = {
    "one": "all single effects",
    "none": "nothing hidden",
    "pair": "pairs",
    "triple": "triples",
    "unknown": "in no catalogue",
}
CLOSE = 0.05  # of a size


def tabulated(records: Sequence[Record]) -> dict[str, Any]:
    """Return the rows of the table, the marks, and the counts of the picture."""
    rows = []
    for kind in KINDS:
        of_kind = [r for r in records if r["kind"] == kind]
        if kind in ("one", "none", "unknown"):
            names = sorted({_what(r) for r in of_kind})
            for name in names if len(names) > 1 or kind != "none" else ():
                rows.append(_row(name, [r for r in of_kind if _what(r) == name]))
        if of_kind:
            rows.append(_row(WHOLE[kind], of_kind))
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
    """Compare with what is asked; shares all, by how many cases.

    The gap is that of cases in which an effect of the catalogue is hidden. The workflow begins at a
    lamp without harmonics, which may close nearly all of it; so the share that is closed beside
    them is told, too.
    """
    by_kind = {kind: [r for r in records if r["kind"] == kind] for kind in KINDS}
    hidden = [r for kind in ("one", "pair", "triple") for r in by_kind[kind]]
    off = [error for r in hidden for error in _errors(r)]
    closed = [r["closed"] for r in hidden if r["closed"] is not None]
    beside = [r["closed_beside"] for r in hidden if r["closed_beside"] is not None]
    names = [float(bool(r["wrong_names"])) for r in records]
    median, share = statistics.median, _mean
    asked: list[tuple[str, bool, float, Any, Sequence[float]]] = [
        ("nothing hidden: right", True, 0.95, share, _are(by_kind["none"], RIGHT)),
        ("single: right name or class", True, 0.9, share, _are(by_kind["one"], RIGHT, REST)),
        ("pairs: both named", True, 0.75, share, _are(by_kind["pair"], RIGHT, REST)),
        ("cases with a wrong name", False, 0.02, share, names),
        ("in no catalogue: right", True, 0.95, share, _are(by_kind["unknown"], RIGHT)),
        ("gap above the floor closed, median", True, 0.9, median, closed),
        ("beside the lamp's harmonics, median", True, 0.9, median, beside),
        ("size off by, median", False, CLOSE, median, off),
    ]
    out: list[dict[str, Any]] = []
    for mark, least, limit, summary, values in asked:
        value = _of(summary, values)
        reached = None if value is None else value >= limit if least else value <= limit
        out.append(
            {"mark": mark, "asked": limit, "at_least": least, "value": value,
             "cases": len(values), "reached": reached}
        )  # fmt: skip
    near = _of(share, [float(error <= CLOSE) for error in off])
    told = {"mark": "size within 5 %", "asked": None, "at_least": True, "value": near}
    return [*out, {**told, "cases": len(off), "reached": None}]


def text(document: dict[str, Any], *, on_page: bool = False) -> str:
    """Write the tables for a terminal, or in Markdown for a page."""
    cases = [[write(row) for _, write in _COLUMNS] for row in document["rows"]]
    wrong = [
        [hidden, ", ".join(f"{name} ×{n}" if n > 1 else name for name, n in names.items())]
        for hidden, names in document["named_wrongly"].items()
    ]
    reached = {True: "yes", False: "no", None: ""}
    against = [
        [
            mark["mark"],
            _asked(mark),
            _percent(mark["value"]),
            str(mark["cases"]),
            reached[mark["reached"]],
        ]
        for mark in document["marks"]
    ]
    return titled(
        (
            ("cases", [title for title, _ in _COLUMNS], cases),
            ("named wrongly", ("hidden", "named"), wrong),
            ("marks", ("mark", "asked", "is", "cases", "reached"), against),
        ),
        [_NOTE],
        on_page=on_page,
    )


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
    """1 for each record with one of the outcomes, 0 for each other."""
    return [float(r["outcome"] in outcomes) for r in records]


def _errors(record: Record) -> list[float]:
    """Return for each effect whose size is told how far off it is, by its worst parameter."""
    worst: dict[str, float] = {}
    for key, error in record["relative_error"].items():
        if error is not None:
            effect = key.partition(".")[0]
            worst[effect] = max(worst.get(effect, 0.0), abs(error))
    return list(worst.values())


def _row(name: str, records: Sequence[Record]) -> dict[str, Any]:
    """Summarise the cases of one row."""
    outcome = Counter(r["outcome"] for r in records)
    off = [error for r in records for error in _errors(r)]
    sure = [abs(e) for r in records for e in r["error_over_stderr"].values() if e is not None]
    closed = [r["closed"] for r in records if r["closed"] is not None]
    beside = [r["closed_beside"] for r in records if r["closed_beside"] is not None]
    idle = [abs(r["idle_error"]) for r in records if r["idle_error"] is not None]
    return {
        "hidden": name,
        "kind": records[0]["kind"],
        "times": records[0]["times"],
        "cases": len(records),
        "right": outcome[RIGHT],
        "rest": outcome[REST] + outcome[LEFT],
        "half": outcome[HALF],
        "wrong": outcome[WRONG],
        "missed": outcome[MISSED],
        "wrong_names": sum(bool(r["wrong_names"]) for r in records),
        "by_like": sum(bool(r["by_like"]) for r in records),
        "unexplained": sum(r["verdict"] == "unexplained" for r in records),
        "refused": sum(r["verdict"] == "refused" for r in records),
        "named": (outcome[RIGHT] + outcome[REST]) / len(records),
        "error_median": _of(statistics.median, off),
        "error_close": _of(_mean, [float(error <= CLOSE) for error in off]),
        "within_two": _of(_mean, [float(e <= 2.0) for e in sure]),
        "closed_median": _of(statistics.median, closed),
        "closed_least": _of(min, closed),
        "beside_median": _of(statistics.median, beside),
        "idle_error_median": _of(statistics.median, idle),
        "cpu_median_s": statistics.median(r["cpu_s"] for r in records),
    }


_COLUMNS: tuple[tuple[str, Callable[[dict[str, Any]], str]], ...] = (
    ("hidden", lambda r: str(r["hidden"])),
    ("cases", lambda r: str(r["cases"])),
    ("right", lambda r: str(r["right"])),
    ("and a rest", lambda r: str(r["rest"])),
    ("half", lambda r: str(r["half"] or "")),
    ("wrong", lambda r: str(r["wrong"])),
    ("missed", lambda r: str(r["missed"])),
    ("refused", lambda r: str(r["refused"] or "")),
    ("with wrong names", lambda r: str(r["wrong_names"] or "")),
    ("rightly", lambda r: _percent(r["named"], 0)),
    ("by a like name", lambda r: str(r["by_like"] or "")),
    ("size off by", lambda r: _percent(r["error_median"])),
    ("within 5 %", lambda r: _percent(r["error_close"], 0)),
    ("within 2 std", lambda r: _percent(r["within_two"], 0)),
    ("gap closed, median", lambda r: _percent(r["closed_median"], 2)),
    ("least", lambda r: _percent(r["closed_least"])),
    ("beside", lambda r: _percent(r["beside_median"])),
    ("idle off by", lambda r: _percent(r["idle_error_median"], 2)),
    ("CPU", lambda r: f"{r['cpu_median_s']:.1f} s"),
)


def _asked(mark: dict[str, Any]) -> str:
    if mark["asked"] is None:
        return ""
    return f"{'≥' if mark['at_least'] else '≤'} {_percent(mark['asked'], 0)}"


def _percent(value: float | None, decimals: int = 1) -> str:
    return "–" if value is None else f"{100.0 * value:.{decimals}f} %"


def _of(what: Callable[[Sequence[float]], float], values: Sequence[float]) -> float | None:
    return float(what(values)) if values else None


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
