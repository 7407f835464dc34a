"""Records to rates of false alarms, delays and the trade-off between the two.

The limit that comes with the live stage, from honest feeds that no table counts.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.bounds import count_bound, rate_interval
from rsenf.bench.live.plan import ATTACKS, OTHER
from rsenf.bench.live.rules import LIMIT, false_and_delay, live_at, onsets, span_of
from rsenf.bench.tables import Row, median, versions_of
from rsenf.errors import InputError
from rsenf.live.settings import VERSION

Times = Callable[[Record], Sequence[float]]

VERDICT, ALARMS, NOT_LIVE = "verdict", "verdict or alarm", "no longer live"
CORRELATION = f"correlation < {LIMIT:g}"


def times_of_rules() -> dict[str, Times]:
    """Where each rule's alarms are in a record."""
    return {
        VERDICT: lambda r: r["wrong_s"],
        ALARMS: lambda r: r["alarm_s"],
        NOT_LIVE: lambda r: _not_live(r["verdicts"]),
        CORRELATION: lambda r: dict(map(tuple, r["wrong_at_correlation"]))[LIMIT],
    }


def _not_live(verdicts: Sequence[tuple[float, str]]) -> list[float]:
    """When a feed that was called live was so no longer, whatever it was called then."""
    first = next((n for n, (_, said) in enumerate(verdicts) if said == "live"), len(verdicts))
    return onsets((t_s, said != "live") for t_s, said in verdicts[first:])


def tabulated(records: Sequence[Record]) -> dict[str, Any]:
    """Return the tables and what they were made from, as plain values."""
    rules = times_of_rules()
    return {
        "table": "live",
        "feeds": len(records),
        "parts": sorted({r["part"] for r in records}),
        "seeds": sorted({r["seed"] for r in records}),
        "grids": sorted({r["truth"]["grid"] for r in records}),
        "limits_nats": sorted({r["limit_nats"] for r in records}),
        "versions": versions_of(records),
        "honest": [_honest(name, records, times) for name, times in rules.items()],
        "live_share": _live_share(records),
        "false": _false(records),
        "attacks": [
            row
            for kind in ATTACKS
            for row in _attack(kind, [r for r in records if r["kind"] == kind])
        ],
        "trade_off": {
            "nats": _trade_off(records, "wrong_at_nats"),
            "correlation": _trade_off(records, "wrong_at_correlation"),
        },
    }


def _hours(records: Sequence[Record]) -> float:
    return float(sum(r["honest_s"] for r in records)) / 3600.0


def _rate(false: int, hours: float) -> Row:
    return {
        "hours": hours,
        "false": false,
        "per_hour": false / hours if hours else None,
        "bound_per_hour": count_bound(false) / hours if hours else None,
    }


def _honest(rule: str, records: Sequence[Record], times: Times) -> Row:
    false = sum(false_and_delay(times(r), r["attack_s"])[0] for r in records)
    return {"rule": rule, **_rate(false, _hours(records))}


def _live_share(records: Sequence[Record]) -> float | None:
    """Of the honest time in which a verdict could be expected, the share that was called live."""
    settled_s = sum(r["settled_s"] for r in records)
    return sum(r["live_s"] for r in records) / settled_s if settled_s else None


def _false(records: Sequence[Record]) -> list[Row]:
    """Say where the live stage was wrong about honest pictures: to be looked at one by one."""
    return [
        {"key": r["key"], "t_s": t_s, "said": said}
        for r in records
        for t_s, said in [
            *((t, "stale or frozen") for t in r["wrong_s"]),
            *((t, f"{kind}: {text}") for t, kind, text in r["alarms"]),
        ]
        if t_s < r["honest_s"]
    ]


def _attack(kind: str, records: Sequence[Record]) -> list[Row]:
    return [
        {"kind": kind, "rule": rule, **_found(records, times)}
        for rule, times in times_of_rules().items()
        if records
    ]


def _found(records: Sequence[Record], times: Times) -> Row:
    """Detections and their delays, from the first false picture to the alarm."""
    delays = [false_and_delay(times(r), r["attack_s"])[1] for r in records]
    found = [d for d in delays if d is not None]
    low, high = rate_interval(len(found), len(records)) if records else (0.0, 1.0)
    return {
        "attacks": len(records),
        "live_before": sum(r["before"] == "live" for r in records),
        "found": len(found),
        "found_low": low,
        "found_high": high,
        "delay_median_s": median(found),
        "delay_90_s": float(np.quantile(found, 0.9)) if found else None,
    }


def alarms_at(records: Sequence[Record], field: str) -> list[tuple[float, int, Row]]:
    """Return, for each limit tried, the false alarms and what was found of the attacks.

    Of those that no picture gives away, whatever the limit.
    """
    limits = [limit for limit, _ in records[0][field]] if records else []
    out = []
    for n, limit in enumerate(limits):

        def times(record: Record, n: int = n) -> Sequence[float]:
            found: Sequence[float] = record[field][n][1]
            return found

        false = sum(false_and_delay(times(r), r["attack_s"])[0] for r in records)
        out.append((limit, false, _found([r for r in records if _takes_evidence(r)], times)))
    return out


def _takes_evidence(record: Record) -> bool:
    """Whether an attack has to be told by its light: its pictures are new, to the last bit."""
    return record["kind"] == OTHER or bool(record["truth"].get("recoded"))


def _trade_off(records: Sequence[Record], field: str) -> list[Row]:
    hours = _hours(records)
    return [
        {"limit": limit, **_rate(false, hours), **found}
        for limit, false, found in alarms_at(records, field)
    ]


# False alarms wanted: one a year of a hundred feeds. No study watches so many hours.
WANTED_PER_HOUR = 1.0 / (100 * 365 * 24)
# What a nat is worth beyond what was watched: a true likelihood ratio's would make false alarms
# rarer by e; errors of estimates hang together, and half of it is believed.
WORTH = 0.5


def fitted_nats(records: Sequence[Record]) -> tuple[float, float, float]:
    """Return the limit, the lowest of those tried at which no honest feed was false, and hours.

    At that one, the rate of false alarms is bounded by the hours watched; from there to the wanted
    rate it is extrapolated.

    Raises
    ------
    InputError
        When honest feeds were called stale at every limit tried.
    """
    hours = sum(r["honest_s"] for r in records) / 3600.0
    silent_nats = math.inf
    for nats, false, _ in alarms_at(records, "wrong_at_nats")[::-1]:
        if false:
            break
        silent_nats = nats
    if math.isinf(silent_nats):
        raise InputError("no limit is high enough: honest feeds were called stale at all of them")
    bound_per_hour = count_bound(0) / hours
    beyond = max(math.log(bound_per_hour / WANTED_PER_HOUR), 0.0) / WORTH
    return silent_nats + beyond, silent_nats, hours


def limits_file(records: Sequence[Record]) -> dict[str, Any]:
    """Return what is kept with the live stage.

    Raises
    ------
    InputError
        When honest feeds were called stale at every limit tried.
    """
    nats, silent_nats, hours = fitted_nats(records)
    seeds = [r["seed"] for r in records]
    limits = live_at(nats).limits
    return {
        "version": VERSION,
        "nats": {k: round(v, 2) for k, v in dataclasses.asdict(limits).items()},
        "made": f"rsenf bench live --fit: {hours:.1f} honest hours, seeds {min(seeds)} to "
        f"{max(seeds)}, in {', '.join(sorted({r['truth']['grid'] for r in records}))}: none called "
        f"stale at {silent_nats:g} nats from the surest live down to stale; {span_of(limits):.1f} "
        "for one false alarm a year of a hundred feeds, at half a nat's worth for each beyond",
    }
