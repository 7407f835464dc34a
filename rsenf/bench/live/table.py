"""The live verdict and the literature's rule on feeds: times of alarms, rates, delays, trade-off.

The literature's rule is Pearson's correlation of the camera's ENF with the grid's over a sliding
window of 30 values, one a second, with an alarm below 0.8 (ENF-based replay detection for
surveillance feeds: Nagothu, Chen, Blasch et al.). It gets the same estimates and reference as the
live stage, paired by the host's clock. Both are tried at several limits. The limit that comes with
the live stage is fitted on honest feeds of other data.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.harness import BenchRun, Made, timed
from rsenf.bench.live import ATTACKS, OTHER, DrawnFeed, LivePlan
from rsenf.bench.live.watched import Shown, watch
from rsenf.bench.measure import versions
from rsenf.bench.scenes import FIT, TEST
from rsenf.bench.statistics import Row, count_bound, median, origin_of, rate_interval
from rsenf.bench.tables import Column, made_from, table_of, titled
from rsenf.errors import InputError
from rsenf.live import Live
from rsenf.live.settings import VERSION, Limits, LiveSettings
from rsenf.messages import Alarm, EnfEstimate, Liveness, ReferenceBlock, RowBlock
from rsenf.messages.schema import FloatArray

RECORD_VERSION = 1
SAME_S = 60.0  # alarms closer than this to the one before count as one
SETTLED_S = 60.0  # after which a verdict is expected
WINDOW, LIMIT = 30, 0.8  # of the correlation
# Limits of the trade-off, in nats from the highest "live" down to "stale"; and correlations.
NATS = (6.0, 9.0, 13.0, 19.0, 28.0, 40.0, 57.0)
CORRELATIONS = (-0.5, 0.0, 0.3, 0.5, 0.7, LIMIT, 0.9, 0.95)
WRONG = ("stale", "frozen")
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


def onsets(said: Iterable[tuple[float, bool]]) -> list[float]:
    """Return the times at which an alarm began.

    Parameters
    ----------
    said : iterable of (float, bool)
        Times in order, and whether there is an alarm from then on.
    """
    known = [(math.nan, False), *said]
    return [t_s for (_, before), (t_s, alarming) in pairwise(known) if alarming and not before]


def false_and_delay(times_s: Sequence[float], attack_s: float | None) -> tuple[int, float | None]:
    """Return the number of separate alarms before an attack, and the delay of the first after.

    Parameters
    ----------
    attack_s : float or None
        Time of the first false frame; None without an attack.
    """
    begun_s = math.inf if attack_s is None else attack_s
    delays = [t - begun_s for t in times_s if t >= begun_s]
    before_s = [t for t in times_s if t < begun_s]
    count = sum(t - last >= SAME_S for last, t in pairwise([-math.inf, *before_s]))
    return count, delays[0] if delays else None


def _sliding_correlation(
    messages: Sequence[Any], window: int = WINDOW
) -> Iterator[tuple[int, float]]:
    """Yield the correlation of each full window, with the host's time at which it is available.

    Seconds without a usable estimate are left out, so a feed without a signal has none. An estimate
    waits until the reference covers it; row blocks relate the stream's clock to the host's.
    """
    rows = next(m for m in messages if isinstance(m, RowBlock))
    host_less_stream_ns = rows.header.arrival_time_ns - int(rows.frame_pts_ns[-1])
    known = [m for m in messages if isinstance(m, ReferenceBlock)]
    found = [m for m in messages if isinstance(m, EnfEstimate)]
    freq_hz = np.concatenate([m.freq_hz for m in known])
    begin_ns = known[0].t0_ns + known[0].first * known[0].step_ns - host_less_stream_ns
    middle_ns = np.array([(m.start_pts_ns + m.end_pts_ns) // 2 for m in found], np.int64)
    # The reference is interpolated between the middles of its samples.
    sample = (middle_ns - begin_ns) / known[0].step_ns - 0.5
    camera_hz = np.array([m.enf_hz if m.usable else math.nan for m in found])
    pairs = np.stack([camera_hz, np.interp(sample, range(freq_hz.size), freq_hz, math.nan)], axis=1)
    by = np.searchsorted(np.cumsum([m.samples for m in known]) - 1, sample)
    arrival_ns = [
        max(m.header.arrival_time_ns, known[n].header.arrival_time_ns) if n < len(known) else 0
        for m, n in zip(found, by.tolist(), strict=True)
    ]
    both = np.isfinite(pairs).all(axis=1) & (by < len(known))
    ready_ns = np.maximum.accumulate(np.array(arrival_ns, np.int64))[both].tolist()
    pairs = pairs[both]
    for n in range(window, len(ready_ns) + 1):
        yield ready_ns[n - 1], _correlation(pairs[n - window : n])


def _correlation(pairs: FloatArray) -> float:
    """Return Pearson's correlation of pairs, shape (n, 2); NaN where one side is constant."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.asarray(np.corrcoef(pairs.T))[0, 1])


Verdicts = list[tuple[float, str]]  # each change, and its time in seconds since the first rows


def _wrong_s(verdicts: Verdicts) -> list[float]:
    """Return the times at which the verdict became one of :data:`WRONG`."""
    return onsets((t_s, verdict in WRONG) for t_s, verdict in verdicts)


def _live_s(verdicts: Verdicts, end_s: float) -> float:
    """Return for how long the verdict was live, from :data:`SETTLED_S` to an end."""
    spans = pairwise([*verdicts, (end_s, "")])
    return sum(
        max(min(stop_s, end_s) - max(t_s, SETTLED_S), 0.0)
        for (t_s, said), (stop_s, _) in spans
        if said == "live"
    )


def live_at(nats: float, settings: LiveSettings | None = None) -> LiveSettings:
    """Return settings with all limits scaled to a span of some nats from "live" to "stale"."""
    settings = settings or LiveSettings()
    factor = nats / span_of(settings.limits)
    scaled = {name: value * factor for name, value in dataclasses.asdict(settings.limits).items()}
    return dataclasses.replace(settings, limits=Limits(**scaled))


def span_of(limits: Limits) -> float:
    """Return the span of limits from the highest "live" down to "stale", nats."""
    return limits.most - limits.stale


def _said_live(
    shown: Shown, messages: Sequence[Any], settings: LiveSettings
) -> tuple[Verdicts, list[tuple[float, str, str]]]:
    """Return verdicts, and time, kind and text of alarms that aren't only of severity ``info``."""
    stage, verdicts, alarms = Live(settings), Verdicts(), []
    for message in messages:
        t_s = shown.since_begin_s(message.header.arrival_time_ns)
        for out in stage.update(message):
            if isinstance(out, Liveness) and (not verdicts or out.verdict != verdicts[-1][1]):
                verdicts.append((t_s, out.verdict))
            elif isinstance(out, Alarm) and out.active and out.severity != "info":
                alarms.append((t_s, out.kind, out.text))
    return verdicts, alarms


def watched(feed: DrawnFeed, grids: Path | None) -> dict[str, Any]:
    """Apply every rule to a feed; return the record. ``grids``: folder of measured grids."""
    settings = LiveSettings()
    (shown, messages), track_s = timed(watch, feed, grids)
    (verdicts, alarms), live_s = timed(_said_live, shown, messages, settings)
    attack_ns = shown.attack_ns
    attack_s = None if attack_ns is None else shown.since_begin_s(attack_ns)
    honest_s = feed.length_s if attack_s is None else attack_s
    usable = [m.usable for m in messages if isinstance(m, EnfEstimate)]
    series = _sliding_correlation(messages)
    correlated = [(shown.since_begin_s(host_ns), value) for host_ns, value in series]
    return {
        "version": RECORD_VERSION,
        **{name: getattr(feed, name) for name in ("kind", "part", "seed")},
        "truth": shown.truth,
        "attack_s": attack_s,
        "honest_s": honest_s,
        "usable_ratio": sum(usable) / len(usable) if usable else 0.0,
        "limit_nats": span_of(settings.limits),
        "verdicts": verdicts,
        "alarms": alarms,
        "wrong_s": _wrong_s(verdicts),
        "settled_s": max(honest_s - SETTLED_S, 0.0),
        "live_s": _live_s(verdicts, honest_s),
        "before": next((v for t_s, v in reversed(verdicts) if t_s <= honest_s), ""),
        "wrong_at_nats": [
            (n, _wrong_s(_said_live(shown, messages, live_at(n, settings))[0])) for n in NATS
        ],
        # An undefined correlation, of a constant side, is below any limit.
        "wrong_at_correlation": [
            (limit, onsets((t_s, not value >= limit) for t_s, value in correlated))
            for limit in CORRELATIONS
        ],
        "cpu_s": {"track": round(track_s, 2), "live": round(live_s, 2)},
        "versions": versions(),
    }


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


def measure(run: BenchRun) -> Made:
    """Watch the feeds that are missing."""
    plan: LivePlan = run.settings(part=FIT if run.options.fit else TEST)
    work = partial(watched, grids=run.options.grids)
    feeds = {feed.key: (feed,) for feed in plan.feeds()}
    records = run.records(feeds, work, "live.jsonl", "feeds")
    return Made(_tabulated(records), _text, fitted=partial(_limits_file, records))
