"""A calibration measured: lines, reliability and decisions as tables and as a picture."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench.calibration import QUESTIONS, cost_of_ratios, fitted, pairs_of, reliability
from rsenf.bench.calibration.real_clips import there
from rsenf.bench.calibration.searches import real_searched, searched
from rsenf.bench.harness import BenchRun, Made, Tasks
from rsenf.bench.scenes import FIT, TEST
from rsenf.bench.statistics import Row, mean, rate_bound, rms
from rsenf.bench.tables import Column, picture, shown, table_of, titled
from rsenf.errors import UsageError
from rsenf.match.calibration import VERSION, CalibrationLine, calibration
from rsenf.match.phase import SURE_STDS, least_of_best
from rsenf.match.settings import MatchSettings

_ASKED = {
    "other": "this time or another in the reference",
    "absent": "this time or one outside the reference",
    "claim": "a claimed time or another",
}
BINS = 5
Lines = dict[str, CalibrationLine]  # by question


def _calibration_file(lines: Lines, records: Sequence[Record]) -> dict[str, Any]:
    """Return the calibration file that comes with the matcher."""
    seeds, real = [r["seed"] for r in records], sum("damage" in r for r in records)
    return {
        "version": VERSION,
        "made": f"rsenf bench calibration: {len(records)} searches, {real} of them of real clips "
        f"made worse, seeds {min(seeds)} to {max(seeds)}, in "
        f"{', '.join(sorted({r['grid'] for r in records}))}",
        "lines": {name: dataclasses.asdict(line) for name, line in lines.items()},
    }


def _tabulated(lines: Lines, records: Sequence[Record]) -> dict[str, Any]:
    """Return the reliability of the lines on some searches, and the decisions with them."""
    questions = []
    for name in QUESTIONS:
        pairs, line = pairs_of(records, name), lines[name]
        questions.append({
            "question": name, "line": dataclasses.asdict(line), "held": pairs.held.size,
            "failed": pairs.failed.size, "cllr_bits": cost_of_ratios(pairs, line),
            "rows": reliability(pairs, line),
        })  # fmt: skip
    return {
        "searches": len(records),
        "grids": sorted({r["grid"] for r in records}),
        "questions": questions,
        "decisions": _decisions(lines, records),
        "clock": _clock(records),
    }


def _decisions(lines: Lines, records: Sequence[Record]) -> dict[str, Any]:
    """Count the matches at both ratios, with the time in the reference and without it."""
    limit = MatchSettings().min_log10_lr

    def matches(case: str) -> list[dict[str, Any]]:
        best = [r[case] for r in records if r.get(case)]
        other, absent = lines["other"], lines["absent"]
        return [b for b in best if min(other(b["other"]), absent(b["absent"])) >= limit]

    found, absent = matches("present"), len(matches("absent"))
    right = sum(best["right"] for best in found)
    return {
        "searches": len(records), "found": right, "found_wrong": len(found) - right,
        "absent_found": absent, "absent_found_below": rate_bound(absent, len(records)),
    }  # fmt: skip


def _clock(records: Sequence[Record]) -> dict[str, Any]:
    """Return the rms of the errors of lag and clock over standard errors, of correct times."""
    right = [r["present"] for r in records if r.get("present") and r["present"]["right"]]
    sure = [p for p in right if p["absent"] >= 2 and p["clock_error_ppm"] is not None]
    clock = [p["clock_error_ppm"] / p["clock_std_ppm"] for p in sure]
    return {
        "cases": len(sure),
        "lag_spread": rms([p["lag_error_s"] / p["lag_std_s"] for p in sure]),
        "clock_spread": rms(clock),
        "clock_within_two": mean([abs(one) <= 2 for one in clock]),
    }


def _text(document: dict[str, Any], *, on_page: bool = False) -> str:
    parts, real = [_searches_text(document, on_page=on_page)], document.get("real")
    if real:
        parts += [
            _searches_text(real, on_page=on_page),
            _damage_text(real["damage"], on_page=on_page),
        ]
    return "\n\n".join(parts)


def _searches_text(document: dict[str, Any], *, on_page: bool) -> str:
    tables = [
        table_of(
            f"{_ASKED[found['question']]}: held {found['held']}, failed {found['failed']}; "
            f"calibrated = {line['slope']:g} · raw {line['intercept']:+g}, at most "
            f"{line['limit']:g}; Cllr {found['cllr_bits']:.3f} bits",
            RELIABILITY,
            found["rows"],
        )
        for found in document["questions"]
        for line in [found["line"]]
    ]
    counts, clock = document["decisions"], document["clock"]
    notes = (
        f"{document['searches']} searches in {', '.join(document['grids'])}: match at both ratios "
        "≥ 100: {found} of {searches} present, {found_wrong} of them wrongly; {absent_found} of "
        "{searches} absent (below {absent_found_below:.2%} with 95 %)\n".format(**counts)
        + f"errors over standard errors, rms of {clock['cases']}: "
        f"lag {shown(clock['lag_spread'], '.2f')}, clock {shown(clock['clock_spread'], '.2f')}, "
        f"{shown(clock['clock_within_two'], '.0%')} within two"
    )
    return titled(tables, [notes], on_page=on_page)


def _span(row: Row) -> str:
    ends = [row["from_log10_lr"], row["to_log10_lr"]]
    low, high = ("" if end is None else f"{end:+g}" for end in ends)
    return f"{low} … {high}".strip()


# Of :func:`rsenf.bench.calibration.reliability`.
RELIABILITY: tuple[Column, ...] = (
    ("log10 LR", _span), ("said", "said", ".1f %"), ("came", "came", ".1f %"),
    ("95 %", lambda row: f"{row['low']:.1%} to {row['high']:.1%}"),
    ("held", "held"), ("failed", "failed"),
)  # fmt: skip


def _over_damage(lines: Lines, records: Sequence[Record]) -> dict[str, Any]:
    """Count decisions by damage of real clips, in equal steps, and in all."""
    of_step: list[list[Record]] = [[] for _ in range(BINS)]
    for record in records:
        of_step[min(int(record["damage"] * BINS), BINS - 1)].append(record)
    total = _counts(lines, records)
    sure = total["found"] + total["excluded"] + total["absent_found"] + total["absent_excluded"]
    false = total["wrong"] + total["excluded"] + total["absent_found"]
    return {
        "rows": [_counts(lines, of) | {"from_damage": i / BINS} for i, of in enumerate(of_step)],
        "total": total,
        "decided": sure,
        "decided_falsely": false,
        "falsely_below": rate_bound(false, sure),
        "excluded_below": rate_bound(total["excluded"], total["clips"] - total["short"]),
    }


def _counts(lines: Lines, records: Sequence[Record]) -> dict[str, int]:
    """Count the decisions on real clips.

    ``found``, of which ``wrong``, and ``excluded`` are of references with the time, ``absent`` of
    those without it. ``short`` clips have too few usable seconds for a comparison.
    """
    usable = [r for r in records if r["usable"]]
    present, absent, day = (
        [_decided(lines, r[case], r["least"]) for r in usable]
        for case in ("present", "absent", "absent_day")
    )
    found = [r["present"] for r, said in zip(usable, present, strict=True) if said == "match"]
    elsewhere = absent + day
    return {
        "clips": len(records), "short": len(records) - len(usable), "found": len(found),
        "wrong": sum(not best["right"] for best in found), "excluded": present.count("no_match"),
        "absent": len(elsewhere), "absent_excluded": elsewhere.count("no_match"),
        "absent_found": elsewhere.count("match"),
    }  # fmt: skip


def _decided(lines: Lines, best: dict[str, Any] | None, least: float) -> str:
    settings = MatchSettings()
    if best is None:
        return "no_decision"
    least = max(least, least_of_best(best["score"]))
    other, absent = lines["other"](best["other"]), max(lines["absent"](best["absent"]), least)
    if min(other, absent) >= settings.min_log10_lr:
        is_sure = SURE_STDS * best["lag_std_s"] <= settings.tolerance_s
        return "match" if is_sure else "no_decision"
    return "no_match" if absent <= -settings.min_log10_lr else "no_decision"


def _damage_text(document: dict[str, Any], *, on_page: bool = False) -> str:
    rows = [*document["rows"], document["total"]]
    note = (
        f"decided {document['decided']}, of these falsely {document['decided_falsely']} "
        f"(below {document['falsely_below']:.2%} with 95 %); true times excluded below "
        f"{document['excluded_below']:.2%}"
    )
    damaged = table_of("Real clips made worse, over the damage", _DAMAGE, rows)
    return titled([damaged], [note], on_page=on_page)


def _damage(row: Row) -> str:
    begin = row.get("from_damage")
    return "all" if begin is None else f"{begin:.1f} … {begin + 1 / BINS:.1f}"


_DAMAGE: tuple[Column, ...] = (
    ("damage", _damage), ("clips", "clips"), ("too short", "short"), ("found", "found"),
    ("wrong", "wrong"), ("excluded", "excluded"), ("elsewhere", "absent"),
    ("excluded there", "absent_excluded"), ("found there", "absent_found"),
)  # fmt: skip
_COLOURS = {"other": "#0b62a4", "absent": "#c23b22", "claim": "#3a7d44"}


def _draw(path: Path, document: dict[str, Any]) -> None:
    """Draw expected and observed shares of true propositions into a PNG file."""
    with picture(path, (7, 6)) as figure:
        axes = figure.subplots()
        axes.plot([0, 1], [0, 1], color="#9a9a9a", linewidth=1, zorder=0)
        for found in document["questions"]:
            rows = found["rows"]
            below = [max(r["came"] - r["low"], 0.0) for r in rows]
            above = [max(r["high"] - r["came"], 0.0) for r in rows]
            axes.errorbar(
                [r["said"] for r in rows], [r["came"] for r in rows], yerr=[below, above], fmt="o",
                capsize=3, color=_COLOURS[found["question"]], label=_ASKED[found["question"]],
            )  # fmt: skip
        axes.set_xlabel("share of cases that the likelihood ratios mean")
        axes.set_ylabel("share that came, with its 95 % interval")
        axes.set_title(f"{document['searches']} searches", loc="left")
        axes.legend(loc="upper left", frameon=False)


def measure(run: BenchRun) -> Made:
    """Search for simulated clips, and for real ones where they are there."""
    options, grids = run.options, run.options.grids
    if grids is None:
        raise UsageError("calibration needs measured grids", "name their folder with --grids")
    part, few = FIT if options.fit else TEST, 12 if options.quick else 0

    def tasks(kind: str, count: int) -> Tasks:
        seeds = range(options.seed, options.seed + count)
        return {f"{kind}{part} {seed}": (part, seed, grids) for seed in seeds}

    simulated = tasks("", options.clips or few or 400)
    records, real = run.records(simulated, searched, "calibration.jsonl", "searches"), []
    if there(grids):
        worse = tasks("real ", options.real or few or 200)
        real = run.records(worse, real_searched, "real.jsonl", "real clips")
    else:
        run.note(f"no real clips in {grids}: nothing is said of them")
    every = [*records, *real]
    lines = calibration().lines
    if options.fit:
        lines = {question: fitted(pairs_of(every, question)) for question in QUESTIONS}
    document = _tabulated(lines, records)
    if real:
        document["real"] = _tabulated(lines, real) | {"damage": _over_damage(lines, real)}
    return Made(document, _text, _draw, lambda: _calibration_file(lines, every))
