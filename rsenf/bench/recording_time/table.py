"""Records of trials to the tables: decisions, errors, the paper's figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench.harness import BenchRun, Made
from rsenf.bench.recording_time import MOVING, STILL
from rsenf.bench.recording_time import trials as matching
from rsenf.bench.recording_time.trials import FALSE, METHODS, NONE, PAPER_METRICS, PRESENT, TRUE
from rsenf.bench.scenes import LOSSLESS
from rsenf.bench.statistics import Row, grouped, mean, median, origin_of, rate_bound, rms
from rsenf.bench.tables import Column, by_method, made_from, shown, table_of, titled

# The paper's tables of decisions by Metrics 1 to 4, per cent; the others are none.
PUBLISHED: tuple[Row, ...] = tuple(
    dict(zip(("kind", "videos", "coded", "true", "false"), row, strict=True))
    for row in (
        (STILL, 12, False, (100.0,) * 4, (0.0,) * 4),
        (STILL, 48, True, (45.83, 56.25, 68.75, 70.83), (0.0, 4.17, 4.17, 2.08)),
        (MOVING, 24, True, (62.5, 75.0, 79.16, 83.33), (8.33, 8.33, 12.5, 8.33)),
    )
)
FALSE_FROM_S = 120.0  # long clips, of which false decisions are counted apart
WITHIN_STD = 2.0
ALL = "all"
COMPRESSED = "compressed"
LONGER = f"≥{FALSE_FROM_S:g}"
_NOTE = """\
TD/FD/ND: decisions that are true (within 1 s), false, and none, per cent of the trials.
absent: the day of the film without 10 minutes on either side of it, and a day of another year;
any match there is false. bound: the rate that so few refute with 95 % confidence, were the trials
independent; those of one film aren't quite. Clips are cut from films that were encoded whole."""


def _order_rows(trials: Sequence[Row]) -> list[Row]:
    """Return true decisions of Metrics 1 to 4, and whether their numbers are in ascending order."""
    of_paper = [
        t | {"coded": LOSSLESS if t["coding"] == LOSSLESS else COMPRESSED, "length_s": length}
        for t in trials
        if t["method"] in PAPER_METRICS and t["trial"] == PRESENT
        for length in (t["length_s"], ALL)
    ]
    rows = []
    for cell, found in grouped(of_paper, "kind", "coded", "length_s"):
        by_metric = [[t for t in found if t["method"] == method] for method in PAPER_METRICS]
        counts, wrong = ([_count(of, said) for of in by_metric] for said in (TRUE, FALSE))
        outcome = {"true": counts, "false": wrong, "holds": counts == sorted(counts)}
        rows.append(cell | {"trials": len(by_metric[0])} | outcome)
    return rows


def _decisions(found: Sequence[Row]) -> Row:
    trials = [t for t in found if t["trial"] == PRESENT]
    counts = {outcome: _count(trials, outcome) for outcome in (TRUE, FALSE, NONE)}
    rates = {f"{outcome}_percent": _percent(n, len(trials)) for outcome, n in counts.items()}
    return {"present": len(trials), **counts, **rates, "broke": sum("broke" in t for t in found)}


def _absent(found: Sequence[Row]) -> Row:
    trials = [t for t in found if t["trial"] != PRESENT]
    wrong = _count(trials, FALSE)
    rates = {"absent_false_percent": _percent(wrong, len(trials)),
             "absent_bound_percent": 100 * rate_bound(wrong, len(trials))}  # fmt: skip
    return {"absent": len(trials), "absent_false": wrong, **rates}


def _count(trials: Sequence[Row], outcome: str) -> int:
    return sum(t.get("outcome") == outcome for t in trials)


def _percent(count: int, of: int) -> float | None:
    return 100 * count / of if of else None


def _errors(found: Sequence[Row], what: str, unit: str) -> dict[str, Any]:
    """Return errors of the true decisions, and their standard errors."""
    right = [t for t in found if t.get("outcome") == TRUE]
    pairs = [(t[f"{what}_error_{unit}"], t[f"{what}_std_{unit}"]) for t in right]
    known = [(e, s) for e, s in pairs if e is not None and s]
    return {
        f"{what}_rms_{unit}": rms([e for e, _ in pairs if e is not None]),
        f"{what}_std_{unit}": median([s for _, s in known]),
        f"{what}_within": mean([abs(e) <= WITHIN_STD * s for e, s in known]),
    }


def _tabulated(records: Sequence[Record]) -> Row:
    trials = [{"kind": r["kind"]} | trial for r in records for trial in r["trials"]]
    cells = grouped(trials, "kind", "coding", "length_s", "method")
    errors = [_errors(found, "lag", "s") | _errors(found, "clock", "ppm") for _, found in cells]
    pooled = [t | {"length_s": ALL} for t in trials]
    longer = [t | {"length_s": LONGER} for t in trials if t["length_s"] >= FALSE_FROM_S]
    lengths = grouped([*trials, *pooled, *longer], "length_s", "method")
    return {
        "table": "recording-time",
        "films": len({(r["kind"], r["seed"]) for r in records}),
        **origin_of(records),
        "references_h": sorted({r["reference_s"] / 3600 for r in records}),
        "noise_mhz": sorted({r["noise_mhz"] for r in records}),
        "rows": [
            cell | _decisions(found) | _absent(found) | error
            for (cell, found), error in zip(cells, errors, strict=True)
        ],
        "absent": [cell | _absent(found) for cell, found in lengths],
        "order": _order_rows(trials),
        "published": list(PUBLISHED),
    }


def _text(document: Row, *, on_page: bool = False) -> str:
    made = made_from(
        document,
        "films",
        f"grid: {', '.join(document['grids'])}",
        "reference: " + ", ".join(f"{h:g} h" for h in document["references_h"]),
        "its noise: " + ", ".join(f"{n:g} mHz" for n in document["noise_mhz"]),
    )
    order = document["order"]
    every = sorted(document["rows"], key=lambda row: METHODS.index(row["method"]))
    if {row["method"] for row in every} & set(PAPER_METRICS):
        every += [row for one in document["published"] for row in _as_published(one)]
    columns = ("film", "kind"), ("coding", "coding"), ("clip", _length), ("trials", "present")
    absent = "False decisions with the true time absent, all films and codings"
    held = f"in order in {sum(row['holds'] for row in order)} of {len(order)} cells"
    tables = (
        by_method("TD/FD/ND with the true time in the reference", columns, _decided, every),
        table_of(absent, _FALSE, document["absent"]),
        table_of(f"True decisions of Metrics 1 to 4: {held}", _ORDER, order),
    )
    return titled(tables, [_NOTE, made], on_page=on_page)


def _decided(row: Row) -> str:
    broke = f" {row['broke']} broke" if row["broke"] else ""
    return "/".join(f"{row[f'{o}_percent']:.0f}" for o in ("true", "false", "none")) + broke


def _as_published(one: Row) -> Iterator[Row]:
    coding = "the paper's, coded" if one["coded"] else "the paper's originals"
    cell = {"kind": one["kind"], "coding": coding, "length_s": "", "present": one["videos"]}
    for method, true, false in zip(PAPER_METRICS, one["true"], one["false"], strict=True):
        rates = {"true_percent": true, "false_percent": false, "none_percent": 100 - true - false}
        yield {**cell, "method": method, "broke": 0, **rates}


def _length(row: Row) -> str:
    value = row["length_s"]
    return value if isinstance(value, str) else f"{value:g} s"


_FALSE: tuple[Column, ...] = (
    ("clip", _length), ("method", "method"), ("absent", "absent"), ("false", "absent_false"),
    ("rate", lambda r: f"{shown(r['absent_false_percent'])} %"),
    ("bound", lambda r: f"{shown(r['absent_bound_percent'])} %"),
)  # fmt: skip
_ORDER: tuple[Column, ...] = (
    ("film", "kind"), ("coding", "coded"), ("clip", _length), ("trials", "trials"),
    *((name, lambda r, n=n: str(r["true"][n])) for n, name in enumerate(PAPER_METRICS)),
    ("false", lambda r: "/".join(map(str, r["false"]))),
    ("each ≥ those before", lambda r: "yes" if r["holds"] else "no"),
)  # fmt: skip


def measure(run: BenchRun) -> Made:
    """Make and try the films that are missing."""
    work = partial(matching.run_trials, grids=run.options.grids)
    films = {film.key: (film,) for film in run.settings().films()}
    records = run.records(films, work, "films.jsonl", "films")
    return Made(_tabulated(records), _text)
