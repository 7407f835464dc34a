"""Every rule on one feed: plain values, nothing concluded yet."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from rsenf.bench.live.plan import Feed
from rsenf.bench.live.rules import CORRELATIONS, NATS, live_at, said_correlation, said_live, span_of
from rsenf.bench.live.watched import watch
from rsenf.bench.measure import versions
from rsenf.live.settings import LiveSettings
from rsenf.messages import EnfEstimate

VERSION = 1
SETTLED_S = 60.0  # after which a feed may be expected to have a verdict


def watched(feed: Feed, grids: Path | None, kept: Path | None) -> dict[str, Any]:
    """Watch a feed by every rule, and return the record.

    Parameters
    ----------
    feed : Feed
    grids, kept : Path or None
        Folders of measured grids, and of estimates that were made before.
    """
    begun = time.process_time()
    seen = watch(feed, grids, kept)
    tracked = time.process_time()
    settings = LiveSettings()
    said = said_live(seen, settings)
    judged = time.process_time()
    attack_ns = seen.shown.attack_ns
    attack_s = None if attack_ns is None else seen.since_begin_s(attack_ns)
    honest_s = feed.length_s if attack_s is None else attack_s
    usable = [m.usable for m in seen.messages if isinstance(m, EnfEstimate)]
    return {
        "version": VERSION,
        "key": feed.key,
        "kind": feed.kind,
        "part": feed.part,
        "seed": feed.seed,
        "truth": seen.shown.truth,
        "attack_s": attack_s,
        "honest_s": honest_s,
        "usable_ratio": sum(usable) / len(usable) if usable else 0.0,
        "limit_nats": span_of(settings.limits),
        "verdicts": said.verdicts,
        "alarms": said.alarms,
        "wrong_s": said.wrong_s,
        "alarm_s": said.alarm_s,
        "settled_s": max(honest_s - SETTLED_S, 0.0),
        "live_s": said.seconds_of("live", SETTLED_S, honest_s),
        "before": said.at(honest_s),
        "wrong_at_nats": [
            (nats, said_live(seen, live_at(nats, settings)).wrong_s) for nats in NATS
        ],
        "wrong_at_correlation": list(said_correlation(seen, CORRELATIONS)),
        "cpu_s": {"track": round(tracked - begun, 2), "live": round(judged - tracked, 2)},
        "versions": versions(),
    }
