"""The live stage and the literature's rule on a feed, each at several limits: times of alarms.

The literature's rule is Pearson's correlation of the camera's ENF with the grid's over a sliding
window of 30 values, one a second, with an alarm below 0.8 (ENF-based replay detection for
surveillance feeds: Nagothu, Chen, Blasch et al.). It gets the same estimates and reference as the
live stage, paired by the host's clock.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.harness import timed
from rsenf.bench.live import Feed
from rsenf.bench.live.watched import Shown, watch
from rsenf.bench.measure import versions
from rsenf.live import Live
from rsenf.live.settings import Limits, LiveSettings
from rsenf.messages import Alarm, EnfEstimate, Liveness, ReferenceBlock, RowBlock
from rsenf.messages.schema import FloatArray

VERSION = 1
SAME_S = 60.0  # alarms closer than this to the one before count as one
SETTLED_S = 60.0  # after which a verdict is expected
WINDOW, LIMIT = 30, 0.8  # of the correlation
# Limits of the trade-off, in nats from the highest "live" down to "stale"; and correlations.
NATS = (6.0, 9.0, 13.0, 19.0, 28.0, 40.0, 57.0)
CORRELATIONS = (-0.5, 0.0, 0.3, 0.5, 0.7, LIMIT, 0.9, 0.95)
WRONG = ("stale", "frozen")


def onsets(said: Iterable[tuple[float, bool]]) -> list[float]:
    """Return the times at which an alarm began.

    Parameters
    ----------
    said : iterable of (float, bool)
        Times in order, and whether there is an alarm from then on.
    """
    known = [(math.nan, False), *said]
    return [t_s for (_, before), (t_s, alarming) in pairwise(known) if alarming and not before]


def _separate_alarms(times_s: Sequence[float]) -> list[float]:
    """Return the alarms without those that follow another within :data:`SAME_S`."""
    return [t for before, t in pairwise([-math.inf, *times_s]) if t - before >= SAME_S]


def false_and_delay(times_s: Sequence[float], attack_s: float | None) -> tuple[int, float | None]:
    """Return the number of alarms before an attack, and the delay of the first one after it began.

    Parameters
    ----------
    attack_s : float or None
        Time of the first false frame; None without an attack.
    """
    begun_s = math.inf if attack_s is None else attack_s
    delays = [t - begun_s for t in times_s if t >= begun_s]
    before = [t for t in times_s if t < begun_s]
    return len(_separate_alarms(before)), delays[0] if delays else None


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


def watched(feed: Feed, grids: Path | None) -> dict[str, Any]:
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
        "version": VERSION,
        "key": feed.key,
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
