"""The limit that comes with the live stage, from honest feeds that no table counts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench.bounds import count_bound
from rsenf.bench.live.rules import live_at, span_of
from rsenf.bench.live.table import alarms_at
from rsenf.errors import InputError
from rsenf.live.settings import VERSION

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
