"""Detects daylight saving in times without a zone: an hour that is skipped or repeated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple
from zoneinfo import ZoneInfo, available_timezones

import numpy as np

from rsenf.messages.schema import Int64Array
from rsenf.reference.local_time import QUARTER_NS, offsets_s
from rsenf.timebase import NS_PER_S

HOUR_NS = 3600 * NS_PER_S
LEAST_SLACK_NS = 60 * NS_PER_S  # some values next to the hour may be missing
ENOUGH = 0.9  # share of an hour's stamps that must occur twice
# Tried first, since most readers know them.
_USUAL = (
    "Europe/Berlin", "Europe/London", "Europe/Athens", "America/New_York", "America/Chicago",
    "America/Denver", "America/Los_Angeles", "Australia/Sydney", "America/Sao_Paulo",
)  # fmt: skip


class Jump(NamedTuple):
    """An hour from ``local_ns`` on that is 'skipped' or 'repeated', as in the zone ``zone``."""

    local_ns: int
    what: str
    zone: str


def find_jump(local_ns: Int64Array) -> Jump | None:
    """Return the first jump in time stamps, in file order, that is due to daylight saving.

    Parameters
    ----------
    local_ns : ndarray of int64, shape (n,)
        Wall-clock times as if they were UTC since 1970.
    """
    steps = np.diff(local_ns)
    moving = steps[steps != 0]
    if not moving.size:
        return None
    if np.median(moving) < 0:  # newest first
        return find_jump(local_ns[::-1])
    usual_ns = float(np.median(moving))
    slack_ns = min(max(LEAST_SLACK_NS, 2 * usual_ns), QUARTER_NS)
    for quarter, what in _hours(local_ns, steps, usual_ns, slack_ns):
        if zone := _zone_that(what, quarter):
            return Jump(quarter * QUARTER_NS, what, zone)
    return None


def _hours(
    local_ns: Int64Array, steps: Int64Array, usual_ns: float, slack_ns: float
) -> Iterator[tuple[int, str]]:
    """Yield the first quarter of each hour that is missing or occurs twice."""
    skipped = np.flatnonzero((steps >= HOUR_NS) & (steps <= HOUR_NS + slack_ns))
    for quarter in _quarters(local_ns[skipped], local_ns[skipped + 1] - HOUR_NS):
        yield quarter, "skipped"
    back = np.flatnonzero((steps < 0) & (steps >= -HOUR_NS) & (steps <= slack_ns - HOUR_NS))
    for quarter in _quarters(local_ns[back + 1], local_ns[back] - HOUR_NS):
        yield quarter, "repeated"
    # In a sorted file the two passes of a repeated hour are interleaved.
    quarters, twice = np.unique(local_ns[1:][steps == 0] // QUARTER_NS, return_counts=True)
    doubled = dict(zip(quarters.tolist(), twice.tolist(), strict=True))
    for quarter in doubled:
        inside = sum(doubled.get(quarter + i, 0) for i in range(4))
        beside = doubled.get(quarter - 1, 0) + doubled.get(quarter + 4, 0)
        if inside * usual_ns >= ENOUGH * HOUR_NS and not beside:
            yield quarter, "repeated"


def _quarters(*near_ns: Int64Array) -> list[int]:
    """Return the quarters of an hour that begin nearest to some times."""
    return [int(q) for q in np.unique((np.concatenate(near_ns) + QUARTER_NS // 2) // QUARTER_NS)]


def _zone_that(what: str, quarter: int) -> str | None:
    """Return a zone that skips or repeats exactly the hour that begins with this quarter."""
    others = sorted(available_timezones() - set(_USUAL))
    return next((n for n in (*_USUAL, *others) if _does(ZoneInfo(n), what, quarter)), None)


def _does(zone: ZoneInfo, what: str, quarter: int) -> bool:
    def is_so(at: int) -> bool:
        first, second = offsets_s(at, zone)
        return first < second if what == "skipped" else first > second

    return is_so(quarter) and is_so(quarter + 3) and not (is_so(quarter - 1) or is_so(quarter + 4))
