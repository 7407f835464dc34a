"""Records to rates by hidden effect, and to the confusion matrix, which is drawn."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.discover import KINDS
from rsenf.bench.discover.beside import clock_rows
from rsenf.bench.discover.judge import LEFT, MISSED, REST, RIGHT, WRONG
from rsenf.bench.tables import aligned, markdown, mean, median, percent, picture

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
        "named": (outcome[RIGHT] + outcome[REST]) / len(records),
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


_COLUMNS: tuple[tuple[str, Callable[[dict[str, Any]], str]], ...] = (
    ("hidden", lambda r: ("video: " if r["video"] else "") + str(r["hidden"])),
    ("cases", lambda r: str(r["cases"])),
    ("right", lambda r: str(r["right"])),
    ("and a rest", lambda r: str(r["rest"])),
    ("wrong", lambda r: str(r["wrong"])),
    ("missed", lambda r: str(r["missed"])),
    ("rightly named", lambda r: percent(r["named"], ".0f")),
    ("size off by", lambda r: percent(r["error_median"], ".1f")),
    ("within 2 std", lambda r: percent(r["within_two"], ".1f")),
    ("gap closed, median", lambda r: percent(r["shrinkage_median"], ".2f")),
    ("least", lambda r: percent(r["shrinkage_least"], ".1f")),
    (
        "model lacks nothing",
        lambda r: f"{r['given_back_lack_nothing']}/{r['given_back']}" if r["given_back"] else "–",
    ),
    ("CPU", lambda r: f"{r['cpu_median_s']:.1f} s"),
)


def text(document: dict[str, Any], *, on_page: bool = False) -> str:
    """Write the table for a terminal, or in Markdown for a page."""
    written = markdown if on_page else aligned
    lines = [[write(row) for _, write in _COLUMNS] for row in document["rows"]]
    return written([title for title, _ in _COLUMNS], lines)


def draw(path: Path, document: dict[str, Any]) -> None:
    """Draw the confusion matrix into a PNG file.

    Raises
    ------
    RecordingError
        When the file can't be written.
    """
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
