"""The limit that comes with the live stage, from honest feeds that no table counts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from rsenf.bench.live.rules import live_at, span_of
from rsenf.bench.live.table import alarms_at
from rsenf.bench.results import Record
from rsenf.errors import InputError
from rsenf.live.settings import VERSION

# Over the lowest limit of those tried that was silent: hours to be watched are more than those.
MARGIN = 1.5


def limits_file(records: Sequence[Record]) -> dict[str, Any]:
    """Return what is kept with the live stage.

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
    seeds = [r["seed"] for r in records]
    limits = live_at(MARGIN * silent_nats).limits
    return {
        "version": VERSION,
        "nats": {k: round(v, 2) for k, v in dataclasses.asdict(limits).items()},
        "made": f"rsenf bench live --fit: {hours:.1f} honest hours, seeds {min(seeds)} to "
        f"{max(seeds)}, in {', '.join(sorted({r['truth']['grid'] for r in records}))}: none called "
        f"stale at {silent_nats:g} nats from the surest live down to stale, and {MARGIN:g} times "
        f"that taken, {span_of(limits):.1f}",
    }
