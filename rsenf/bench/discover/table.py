"""Blind discovery measured: records of cases to rates, and to the confusion matrix."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from itertools import groupby, product
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.discover import CasePlan, foreign, left_out, listed
from rsenf.bench.discover.judge import HALF, LEFT, MISSED, REST, RIGHT, UNSEEN, WRONG
from rsenf.bench.discover.trial import CLOCK, SKEW, WEAKEST_PPM, clock_cases, tried
from rsenf.bench.foreign import camera_at
from rsenf.bench.harness import BenchRun, Made
from rsenf.bench.statistics import mean, median
from rsenf.bench.tables import SOME, Column, picture, table_of, titled
from rsenf.errors import UsageError

NOTHING, MORE = "nothing", "a rest"  # answers without a name
# Rows of all cases of a kind; the effects of some kinds have rows of their own, too.
WHOLE = {
    "one": "all single effects", "none": "nothing hidden", "pair": "pairs", "triple": "triples",
    "unknown": "in no catalogue", "physical": "physical programs", CLOCK: "",
}  # fmt: skip
EACH = ("one", "none", "unknown", "physical", CLOCK)
OF_CATALOGUE = ("one", "pair", "triple", CLOCK)  # whose gap is to be closed
CLOSE = 0.05  # relative error of a size


def _tabulated(records: Sequence[Record]) -> dict[str, Any]:
    """Return rates and the confusion matrix as plain values."""
    rows = []
    for video, kind in product((False, True), WHOLE):
        of_kind = [r for r in records if (r["kind"], r["video"]) == (kind, video)]
        names = sorted({_what(r) for r in of_kind}) if kind in EACH else []
        if kind != "none" or len(names) > 1:
            rows += [_row(name, [r for r in of_kind if _what(r) == name]) for name in names]
        if of_kind and WHOLE[kind]:
            rows.append(_row(WHOLE[kind], of_kind))
    wrong: dict[str, Counter[str]] = {}
    named: dict[str, Counter[str]] = {}  # of cases with at most one hidden effect
    for r in records:
        if r["wrong_names"]:
            wrong.setdefault(_what(r), Counter()).update(r["wrong_names"])
        if len(r["hidden"]) < 2:
            said = r["named"] or [MORE if r["verdict"] == "unexplained" else NOTHING]
            named.setdefault((r["hidden"] or [NOTHING])[0], Counter()).update(said)
    return {
        "cases": len(records),
        "rows": [*rows, _row("all", records)] if records else [],
        "named": named,
        "named_wrongly": dict(sorted(wrong.items())),
    }


def _what(record: Record) -> str:
    names = " + ".join(record["hidden"])
    if record["kind"] == CLOCK:
        ppm = record["times"] * WEAKEST_PPM
        return f"{SKEW}, {ppm:.0f} ppm" if names else "a true clock, and a reference"
    if record["kind"] == "none":
        return f"{NOTHING} but {names}" if names else NOTHING
    return names


def _row(name: str, records: Sequence[Record]) -> dict[str, Any]:
    """Return counts of outcomes, errors of parameters and the closed gap of some cases."""
    outcome = Counter(r["outcome"] for r in records)
    off = [  # the largest relative error of a parameter, for each effect with one
        max(errors)
        for r in records
        for _, of in groupby(r["relative_error"].items(), lambda error: error[0].partition(".")[0])
        if (errors := [abs(error) for _, error in of if error is not None])
    ]
    sure = [abs(e) for r in records for e in r["error_over_stderr"].values() if e is not None]
    closing = [r for r in records if r["kind"] in OF_CATALOGUE]

    def known(records: Sequence[Record], field: str) -> list[float]:
        return [r[field] for r in records if r.get(field) is not None]

    return {
        "hidden": name,
        "video": all(r["video"] for r in records),
        "cases": len(records),
        "right": outcome[RIGHT],
        "rest": outcome[REST] + outcome[LEFT],
        "half": outcome[HALF],
        "wrong": outcome[WRONG],
        "missed": outcome[MISSED],
        "refused": sum(r["verdict"] == "refused" for r in records),
        "wrong_names": sum(bool(r["wrong_names"]) for r in records),
        "by_like": sum(bool(r["by_like"]) for r in records),
        "named": mean([r["outcome"] in (RIGHT, REST) for r in records if r["outcome"] != UNSEEN]),
        "error_median": median(off),
        "error_close": mean([error <= CLOSE for error in off]),
        "within_two": mean([e <= 2.0 for e in sure]),
        "closed_median": median(known(closing, "closed")),
        "closed_least": min(known(closing, "closed"), default=None),
        "beside_median": median(known(closing, "closed_beside")),
        "idle_error_median": median([abs(error) for error in known(records, "idle_error")]),
        "given_back": sum(bool(r.get("given_back")) for r in records),
        "given_back_lack_nothing": sum(r.get("given_back") == "no_discrepancy" for r in records),
        "cpu_median_s": median(known(records, "cpu_s")),
    }


_COLUMNS: tuple[Column, ...] = (
    ("hidden", lambda r: ("video: " if r["video"] else "") + str(r["hidden"])),
    ("cases", "cases"), ("right", "right"), ("and a rest", "rest"), ("half", "half", SOME),
    ("wrong", "wrong"), ("missed", "missed"), ("refused", "refused", SOME),
    ("with wrong names", "wrong_names", SOME), ("rightly named", "named", ".0f %"),
    ("by a like name", "by_like", SOME), ("size off by", "error_median", ".1f %"),
    ("within 5 %", "error_close", ".0f %"), ("within 2 std", "within_two", ".0f %"),
    ("gap closed, median", "closed_median", ".2f %"), ("least", "closed_least", ".1f %"),
    ("beside", "beside_median", ".1f %"), ("idle off by", "idle_error_median", ".2f %"),
    ("model lacks nothing",
     lambda r: f"{r['given_back_lack_nothing']}/{r['given_back']}" if r["given_back"] else ""),
    ("CPU", "cpu_median_s", ".1f s"),
)  # fmt: skip
_NOTE = """\
a lamp's own harmonics are no wrong name. by a like name: an effect that does nearly the same was
named instead. size off by: the worse of size and frequency; of lost and doubled frames the share
that isn't told or is told wrongly. beside: of the gap that the lamp's harmonics don't close."""


def _text(document: dict[str, Any], *, on_page: bool = False) -> str:
    wrong = [
        [hidden, ", ".join(f"{name} ×{n}" if n > 1 else name for name, n in names.items())]
        for hidden, names in document["named_wrongly"].items()
    ]
    cases = table_of("cases", _COLUMNS, document["rows"])
    return titled([cases, ("named wrongly", ("hidden", "named"), wrong)], [_NOTE], on_page=on_page)


def _draw(path: Path, document: dict[str, Any]) -> None:
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


def measure(run: BenchRun) -> Made:
    """Run the workflow on the cases that are missing, of rsenf's own model or a foreign camera."""
    options = run.options
    each = 20 if options.clips is None else options.clips
    if options.foreign:
        path = options.foreign.absolute()
        camera = foreign.hideable(camera_at(path, foreign.NEEDED), video=options.video)
        many = 0 if _hidden(run, (*camera.kinds,), camera.never) else each
        usual = {"none": 5 * many, "outside": 3 * many, "pairs": 3 * many, "triples": many,
                 "effects": camera.effects}  # fmt: skip
        cases = run.settings(**({} if options.quick else usual)).cases(camera)
        work, file = partial(foreign.tried, path=path), "foreign.jsonl"
    else:
        for option in ("outside", "triples", "rows"):
            if getattr(options, option) is not None:
                raise UsageError(f"--{option} without --foreign", "only a foreign camera has it")
        hidden = _hidden(run, (*listed(), SKEW), left_out())
        if hidden:
            options.hide = [name for name in hidden if name != SKEW]
        many = 0 if hidden or options.video else each
        usual = {"none": 5 * many, "pairs": 2 * many}
        usual |= {"duration_s": 30.0} if options.video else {}
        plan: CasePlan = run.settings(**({} if options.quick else usual))
        cases = plan.cases()
        if not (options.quick or options.video or (hidden and SKEW not in hidden)):
            # Cases with a reference use the seeds that follow the others'.
            cases += clock_cases(plan.each, plan.first_seed + len(cases), plan.duration_s)
        work, file = partial(tried, grids=options.grids), "discover.jsonl"
    records = run.records({case.key: (case,) for case in cases}, work, file, "cases")
    return Made(_tabulated(records), _text, _draw)


def _hidden(run: BenchRun, can: Sequence[str], never: dict[str, str]) -> Sequence[str]:
    """Return the effects of --hide; without it, note which ones aren't hidden, and why."""
    hidden: Sequence[str] = run.options.hide or ()
    if unknown := set(hidden) - set(can):
        why = never.get(min(unknown), "it is no effect")
        raise UsageError(f"--hide {min(unknown)}: {why}", f"one of {', '.join(can)}")
    if not (hidden or run.options.quick):
        for name, why in never.items():
            run.note(f"not hidden among the others: {name}: {why}")
    return hidden
