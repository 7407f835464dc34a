"""Lines, reliability and decisions of a calibration as a table and a picture."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rsenf.bench.calibration import QUESTIONS, Record, cost_of_ratios, fitted, pairs_of, reliability
from rsenf.bench.tables import mean, picture, rate_bound, rms, shown
from rsenf.match.calibration import VERSION, Line
from rsenf.match.phase import SURE_STDS, least_of_best
from rsenf.match.settings import MatchSettings

_ASKED = {
    "other": "this time against another in the reference (the search counted)",
    "absent": "this time against one outside the reference (the search counted)",
    "claim": "a claimed time against another",
}


def fitted_lines(records: Sequence[Record]) -> dict[str, Line]:
    """Fit a line for each question."""
    return {question: fitted(pairs_of(records, question)) for question in QUESTIONS}


def calibration_file(lines: dict[str, Line], records: Sequence[Record]) -> dict[str, Any]:
    """Return the calibration file that comes with the matcher."""
    seeds, real = [r["seed"] for r in records], sum("damage" in r for r in records)
    return {
        "version": VERSION,
        "made": f"rsenf bench calibration: {len(records)} searches, {real} of them of real clips "
        f"made worse, seeds {min(seeds)} to {max(seeds)}, in "
        f"{', '.join(sorted({r['grid'] for r in records}))}",
        "lines": {name: dataclasses.asdict(line) for name, line in lines.items()},
    }


def tabulated(lines: dict[str, Line], records: Sequence[Record]) -> dict[str, Any]:
    """Return the reliability of lines on some searches, and the decisions with them.

    Parameters
    ----------
    lines : dict of str to Line
        By question.
    records : sequence of dict
        Of searches.
    """
    return {
        "searches": len(records),
        "grids": sorted({r["grid"] for r in records}),
        "questions": [
            {
                "question": question,
                "line": dataclasses.asdict(lines[question]),
                "held": pairs_of(records, question).held.size,
                "failed": pairs_of(records, question).failed.size,
                "cllr_bits": cost_of_ratios(pairs_of(records, question), lines[question]),
                "rows": reliability(pairs_of(records, question), lines[question]),
            }
            for question in QUESTIONS
        ],
        "decisions": _decisions(lines, records),
        "clock": _clock(records),
    }


def _decisions(lines: dict[str, Line], records: Sequence[Record]) -> dict[str, Any]:
    limit = MatchSettings().min_log10_lr
    counts = {"present": 0, "found": 0, "found_wrong": 0, "absent": 0, "absent_found": 0}
    for record in records:
        for case in ("present", "absent"):
            best = record.get(case)
            counts[case] += 1
            if best and min(lines["other"](best["other"]), lines["absent"](best["absent"])) < limit:
                continue
            if best and case == "present":
                counts["found" if best["right"] else "found_wrong"] += 1
            elif best:
                counts["absent_found"] += 1
    return counts | {"absent_found_below": rate_bound(counts["absent_found"], counts["absent"])}


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


def text(document: dict[str, Any], *, on_page: bool = False) -> str:
    """Return the outcome as text; Markdown has no other form."""
    parts = [_text(document)]
    if real := document.get("real"):
        parts += [_text(real), damage_text(real["damage"])]
    return "\n\n".join(parts)


def _text(document: dict[str, Any]) -> str:
    lines = [f"{document['searches']} searches in {', '.join(document['grids'])}"]
    for found in document["questions"]:
        line = found["line"]
        lines += [
            "",
            f"{_ASKED[found['question']]}: held {found['held']}, failed {found['failed']}",
            f"  calibrated = {line['slope']:g} · raw {line['intercept']:+g}, at most "
            f"{line['limit']:g}; Cllr {found['cllr_bits']:.3f} bits",
            *reliability_lines(found["rows"]),
        ]
    counts, clock = document["decisions"], document["clock"]
    return "\n".join([
        *lines,
        "",
        f"match at both ratios ≥ 100: {counts['found']} of {counts['present']} present, "
        f"{counts['found_wrong']} of them wrongly; {counts['absent_found']} of "
        f"{counts['absent']} absent (below {counts['absent_found_below']:.2%} with 95 %)",
        f"errors over standard errors, rms of {clock['cases']}: "
        f"lag {shown(clock['lag_spread'], '.2f')}, clock {shown(clock['clock_spread'], '.2f')}, "
        f"{shown(clock['clock_within_two'], '.0%')} within two",
    ])  # fmt: skip


def reliability_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the lines of a table of reliability."""
    head = "  log10 LR        said     came   (95 %)          held  failed"
    return [head, *map(_row, rows)]


def _row(row: dict[str, Any]) -> str:
    ends = [row["from_log10_lr"], row["to_log10_lr"]]
    low, high = ("" if end is None else f"{end:+g}" for end in ends)
    return (
        f"  {low:>4} … {high:<4}    {row['said']:7.1%}  {row['came']:7.1%}  "
        f"({row['low']:.1%} to {row['high']:.1%})".ljust(56)
        + f"{row['held']:5d} {row['failed']:7d}"
    )


BINS = 5
COUNTS = ("clips", "short", "found", "wrong", "excluded", "absent", "absent_excluded",
          "absent_found")  # fmt: skip


def over_damage(lines: dict[str, Line], records: Sequence[Record]) -> dict[str, Any]:
    """Count decisions by damage, in equal steps, and in all.

    In references with the time: ``found``, of which ``wrong`` by more than a few seconds, and
    ``excluded`` falsely. In references without it (``absent``): excluded rightly, and found
    falsely. ``short`` clips have too few usable seconds for a comparison.

    Parameters
    ----------
    lines : dict of str to Line
        By question.
    records : sequence of dict
        Of degraded real clips.
    """
    rows = [dict.fromkeys(COUNTS, 0) for _ in range(BINS)]
    for record in records:
        row = rows[min(int(record["damage"] * BINS), BINS - 1)]
        row["clips"] += 1
        if not record["usable"]:
            row["short"] += 1
            continue
        decision = _decided(lines, record["present"], record["least"])
        row["found"] += decision == "match"
        row["wrong"] += decision == "match" and not record["present"]["right"]
        row["excluded"] += decision == "no_match"
        for case in ("absent", "absent_day"):
            decision = _decided(lines, record[case], record["least"])
            row["absent"] += 1
            row["absent_found"] += decision == "match"
            row["absent_excluded"] += decision == "no_match"
    total = {name: sum(row[name] for row in rows) for name in COUNTS}
    sure = total["found"] + total["excluded"] + total["absent_found"] + total["absent_excluded"]
    false = total["wrong"] + total["excluded"] + total["absent_found"]
    return {
        "rows": [row | {"from_damage": i / BINS} for i, row in enumerate(rows)],
        "total": total,
        "decided": sure,
        "decided_falsely": false,
        "falsely_below": rate_bound(false, sure),
        "excluded_below": rate_bound(total["excluded"], total["clips"] - total["short"]),
    }


def _decided(lines: dict[str, Line], best: dict[str, Any] | None, least: float) -> str:
    """Return the matcher's decision."""
    settings = MatchSettings()
    if best is None:
        return "no_decision"
    least = max(least, least_of_best(best["score"]))
    other, absent = lines["other"](best["other"]), max(lines["absent"](best["absent"]), least)
    if min(other, absent) >= settings.min_log10_lr:
        is_sure = SURE_STDS * best["lag_std_s"] <= settings.tolerance_s
        return "match" if is_sure else "no_decision"
    return "no_match" if absent <= -settings.min_log10_lr else "no_decision"


def damage_text(document: dict[str, Any]) -> str:
    """Return the counts for a terminal."""
    lines = [
        "real clips made worse, over the damage",
        "   damage    clips  too short   found (wrong)  excluded    elsewhere  excluded  found",
    ]
    for row in [*document["rows"], document["total"]]:
        begin = row.get("from_damage")
        name = "all" if begin is None else f"{begin:.1f} … {begin + 1 / BINS:.1f}"
        lines.append(
            f"{name:>12} {row['clips']:6d} {row['short']:10d} {row['found']:7d} "
            f"({row['wrong']}) {row['excluded']:13d} {row['absent']:12d} "
            f"{row['absent_excluded']:9d} {row['absent_found']:6d}"
        )
    return "\n".join([
        *lines,
        f"decided {document['decided']}, of these falsely {document['decided_falsely']} "
        f"(below {document['falsely_below']:.2%} with 95 %); true times excluded below "
        f"{document['excluded_below']:.2%}",
    ])  # fmt: skip


_COLOURS = {"other": "#0b62a4", "absent": "#c23b22", "claim": "#3a7d44"}
_SAID = {
    "other": "this time or another in the reference",
    "absent": "this time or one outside the reference",
    "claim": "a claimed time or another",
}


def draw(path: Path, document: dict[str, Any]) -> None:
    """Draw expected and observed shares of true propositions into a PNG file."""
    with picture(path, (7, 6)) as figure:
        axes = figure.subplots()
        axes.plot([0, 1], [0, 1], color="#9a9a9a", linewidth=1, zorder=0)
        for found in document["questions"]:
            rows = found["rows"]
            expected, observed = [r["said"] for r in rows], [r["came"] for r in rows]
            low, high = [r["low"] for r in rows], [r["high"] for r in rows]
            below = [max(c - a, 0.0) for c, a in zip(observed, low, strict=True)]
            above = [max(b - c, 0.0) for c, b in zip(observed, high, strict=True)]
            axes.errorbar(
                expected, observed, yerr=[below, above], fmt="o", capsize=3,
                color=_COLOURS[found["question"]], label=_SAID[found["question"]],
            )  # fmt: skip
        axes.set_xlabel("share of cases that the likelihood ratios mean")
        axes.set_ylabel("share that came, with its 95 % interval")
        axes.set_title(f"{document['searches']} searches", loc="left")
        axes.legend(loc="upper left", frameon=False)
