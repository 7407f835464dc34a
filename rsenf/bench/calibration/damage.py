"""What is decided of real clips made worse, over the damage: where their time is, and where not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rsenf.bench.bounds import rate_bound
from rsenf.bench.calibration.fit import Record
from rsenf.match.calibration import Line
from rsenf.match.phase import SURE_STDS, least_of_best
from rsenf.match.settings import MatchSettings

BINS = 5
COUNTS = (
    "clips",
    "short",
    "found",
    "wrong",
    "excluded",
    "absent",
    "absent_excluded",
    "absent_found",
)


def over_damage(lines: dict[str, Line], records: Sequence[Record]) -> dict[str, Any]:
    """Count decisions in equal steps of the damage, and in all.

    Of clips searched for where they are: ``found``, of those ``wrong`` at a place more than a few
    seconds off, and ``excluded``, falsely. Of searches where they aren't (``absent``): excluded
    rightly, and found falsely. ``short`` clips have too few usable seconds to be compared.
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
    """Decide as the matcher does."""
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
