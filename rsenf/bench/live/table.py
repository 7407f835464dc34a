"""Records to false alarm rates, detection delays and their trade-off, as tables.

The limit that comes with the live stage is fitted on honest feeds of other data.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import takewhile
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.harness import Made, Run
from rsenf.bench.live import ATTACKS, OTHER
from rsenf.bench.live.rules import LIMIT, false_and_delay, live_at, onsets, span_of, watched
from rsenf.bench.scenes import FIT, TEST
from rsenf.bench.statistics import Row, count_bound, median, origin_of, rate_interval
from rsenf.bench.tables import Column, made_from, table_of, titled
from rsenf.errors import InputError
from rsenf.live.settings import VERSION

# Rate of false alarms to reach: one a year of a hundred feeds.
WANTED_PER_HOUR = 1.0 / (100 * 365 * 24)
# Extrapolation: of a true likelihood ratio, each nat makes false alarms rarer by a factor of e;
# errors of estimates are correlated, so half of that is assumed.
WORTH = 0.5
Times = Callable[[Record], Sequence[float]]
VERDICT, ALARMS, NOT_LIVE = "verdict", "verdict or alarm", "no longer live"
CORRELATION = f"correlation < {LIMIT:g}"
_NOTE = """\
Delay: from the first false picture to the alarm at the monitor, all buffers of the trackers in it;
median and 90 % of those found. live before: attacks on feeds that were called live when they began.
below: the rate that so few false alarms refute with 95 % confidence (Poisson). Honest hours are all
feeds up to their attack. Alarms within a minute of another count as one false alarm.
verdict: stale or frozen. no longer live: any other verdict, no signal too. nats: evidence from the
surest "live" down to "stale". Half of the other cameras are as live as the first. The trade-off is
of the attacks that were coded once more, and of other cameras: no picture gives them away."""


def _not_live(verdicts: Sequence[tuple[float, str]]) -> list[float]:
    """Return the times at which the verdict "live" ended."""
    first = next((n for n, (_, said) in enumerate(verdicts) if said == "live"), len(verdicts))
    return onsets((t_s, said != "live") for t_s, said in verdicts[first:])


# From a record to the alarm times of each rule.
TIMES: dict[str, Times] = {
    VERDICT: lambda r: r["wrong_s"],
    ALARMS: lambda r: sorted([*r["wrong_s"], *(t_s for t_s, _, _ in r["alarms"])]),
    NOT_LIVE: lambda r: _not_live(r["verdicts"]),
    CORRELATION: lambda r: dict(map(tuple, r["wrong_at_correlation"]))[LIMIT],
}


def _tabulated(records: Sequence[Record]) -> dict[str, Any]:
    settled_s = sum(r["settled_s"] for r in records)
    return {
        "table": "live",
        "feeds": len(records),
        "parts": sorted({r["part"] for r in records}),
        **origin_of(records),
        "grids": sorted({r["truth"]["grid"] for r in records}),
        "limits_nats": sorted({r["limit_nats"] for r in records}),
        "honest": [{"rule": rule, **_rate(records, times)} for rule, times in TIMES.items()],
        # Of the honest time after the first verdict is due.
        "live_share": sum(r["live_s"] for r in records) / settled_s if settled_s else None,
        "false": [
            {"key": r["key"], "t_s": t_s, "said": said}
            for r in records
            for t_s, *what in [*((t, "stale or frozen") for t in r["wrong_s"]), *r["alarms"]]
            for said in [": ".join(what)]
            if t_s < r["honest_s"]
        ],
        "attacks": [
            {"kind": kind, "rule": rule, **_found(of_kind, times)}
            for kind in ATTACKS
            if (of_kind := [r for r in records if r["kind"] == kind])
            for rule, times in TIMES.items()
        ],
        "trade_off": {of: _trade_off(records, f"wrong_at_{of}") for of in ("nats", "correlation")},
    }


def _rate(records: Sequence[Record], times: Times) -> Row:
    false = sum(false_and_delay(times(r), r["attack_s"])[0] for r in records)
    hours = float(sum(r["honest_s"] for r in records)) / 3600.0
    return {
        "hours": hours, "false": false, "per_hour": false / hours if hours else None,
        "bound_per_hour": count_bound(false) / hours if hours else None,
    }  # fmt: skip


def _found(records: Sequence[Record], times: Times) -> Row:
    """Return detections and their delays, from the first false frame to the alarm."""
    delays = [false_and_delay(times(r), r["attack_s"])[1] for r in records]
    found = [d for d in delays if d is not None]
    low, high = rate_interval(len(found), len(records)) if records else (0.0, 1.0)
    return {
        "attacks": len(records), "live_before": sum(r["before"] == "live" for r in records),
        "found": len(found), "found_low": low, "found_high": high,
        "delay_median_s": median(found),
        "delay_90_s": float(np.quantile(found, 0.9)) if found else None,
    }  # fmt: skip


def _trade_off(records: Sequence[Record], field: str) -> list[Row]:
    """Return the false alarms, and detections of attacks without repeated frames, by limit."""
    by_enf = [r for r in records if r["kind"] == OTHER or r["truth"].get("recoded")]

    def times(n: int) -> Times:
        return lambda record: record[field][n][1]

    return [
        {"limit": limit, **_rate(records, times(n)), **_found(by_enf, times(n))}
        for n, (limit, _) in enumerate(records[0][field] if records else ())
    ]


def _fitted_nats(records: Sequence[Record]) -> tuple[float, float, float]:
    """Return the fitted limit, the lowest one without false alarms (nats), and the honest hours."""
    rows = _trade_off(records, "wrong_at_nats")[::-1]
    silent = list(takewhile(lambda row: not row["false"], rows))
    if not silent:
        raise InputError("no limit is high enough: honest feeds were called stale at all of them")
    # The hours bound the rate of false alarms at the lowest one; from there it is extrapolated.
    beyond = max(math.log(silent[-1]["bound_per_hour"] / WANTED_PER_HOUR), 0.0) / WORTH
    return silent[-1]["limit"] + beyond, silent[-1]["limit"], silent[-1]["hours"]


def _limits_file(records: Sequence[Record]) -> dict[str, Any]:
    """Return the file of limits that comes with the live stage."""
    nats, silent_nats, hours = _fitted_nats(records)
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


def _text(document: Row, *, on_page: bool = False) -> str:
    live = document["live_share"]
    made = made_from(
        document,
        "feeds",
        f"grids: {', '.join(document['grids'])}",
        "limit: " + ", ".join(f"{n:.1f} nats" for n in document["limits_nats"]),
    )
    made += "" if live is None else f"; called live in {100 * live:.1f} % of the honest time"
    tables = (
        table_of("Honest feeds", _HONEST, document["honest"]),
        table_of("Attacks", _ATTACKS, document["attacks"]),
        *(
            table_of(f"Trade-off by {name}", ((name, "limit", "g"), *_RATES, *_DETECTED), rows)
            for name, rows in document["trade_off"].items()
        ),
        table_of("False alarms of the live stage", _FALSE, document["false"]),
    )
    return titled(tables, [_NOTE, made], on_page=on_page)


_RATES: tuple[Column, ...] = (
    ("hours", "hours", ".1f"), ("false alarms", "false"), ("an hour", "per_hour", ".2g"),
    ("below", "bound_per_hour", ".2g"),
)  # fmt: skip
_DETECTED: tuple[Column, ...] = (
    ("found", lambda r: f"{r['found']}/{r['attacks']}"),
    ("95 % interval", lambda r: f"{100 * r['found_low']:.0f} to {100 * r['found_high']:.0f} %"),
    ("delay", "delay_median_s", ".0f s"), ("90 %", "delay_90_s", ".0f s"),
)  # fmt: skip
_HONEST: tuple[Column, ...] = ("rule", "rule"), *_RATES
_ATTACKS: tuple[Column, ...] = (
    ("attack", "kind"), ("rule", "rule"), ("feeds", "attacks"), ("live before", "live_before"),
    *_DETECTED,
)  # fmt: skip
_FALSE: tuple[Column, ...] = ("feed", "key"), ("at", "t_s", ".0f s"), ("said", "said")


def measure(run: Run) -> Made:
    """Watch the feeds that are missing."""
    feeds = run.settings(part=FIT if run.options.fit else TEST).feeds()
    work = partial(watched, grids=run.options.grids)
    records = run.records(feeds, work, "live.jsonl", "feeds")
    return Made(_tabulated(records), _text, fitted=partial(_limits_file, records))
