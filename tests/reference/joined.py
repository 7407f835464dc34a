"""The reference that blocks are of."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rsenf.messages import ReferenceBlock
from rsenf.reference.reference import Reference
from rsenf.timebase import NO_ZONE, NS_PER_S


def joined(blocks: Iterable[ReferenceBlock]) -> Reference:
    """Join the blocks of one reference; what none of them covers is a gap."""
    parts = list(blocks)
    total = max(max(b.total, b.first + b.samples) for b in parts)
    freq, readings = np.full(total, np.nan), np.zeros(total, np.uint32)
    for block in parts:
        span = slice(block.first, block.first + block.samples)
        freq[span], readings[span] = block.freq_hz, block.readings
    one = parts[0]
    notes = (NO_ZONE,) if one.zone_unknown else ()
    step_s = one.step_ns / NS_PER_S
    return Reference(one.grid, one.nominal_hz, one.t0_ns, step_s, freq, readings, notes)
