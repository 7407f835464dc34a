"""Converts local times to UTC, through the hours that daylight saving skips and repeats.

In times without a zone, such an hour tells that they aren't UTC.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta
from typing import NamedTuple
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.messages.schema import Int64Array
from rsenf.reference.reference import Notes
from rsenf.timebase import NS_PER_S

BoolArray = NDArray[np.bool_]

# For a century, zones have changed their offset only at whole quarters of an hour.
QUARTER_NS = 900 * NS_PER_S
_EPOCH = datetime(1970, 1, 1)
HOUR_NS = 3600 * NS_PER_S
LEAST_SLACK_NS = 60 * NS_PER_S  # some values next to the hour may be missing
ENOUGH = 0.9  # share of an hour's stamps that must occur twice
# Tried first, since most readers know them.
_USUAL = (
    "Europe/Berlin", "Europe/London", "Europe/Athens", "America/New_York", "America/Chicago",
    "America/Denver", "America/Los_Angeles", "Australia/Sydney", "America/Sao_Paulo",
)  # fmt: skip


def to_utc(local_ns: Int64Array, timezone: str, notes: Notes) -> tuple[Int64Array, BoolArray]:
    """Convert local times, in the order in which they were written.

    The order resolves a repeated hour: the first pass lasts until the jump back, the second begins
    after it. If only one pass was recorded, it belongs to the side with the smaller gap.

    Parameters
    ----------
    local_ns : ndarray of int64, shape (n,)
        Wall-clock times as if they were UTC since 1970.
    timezone : str
        IANA name.
    notes : Notes
        Gets the number of times that could not be converted.

    Returns
    -------
    utc_ns : ndarray of int64, shape (n,)
    known : ndarray of bool, shape (n,)
        False for times that don't exist or are ambiguous.

    Raises
    ------
    UsageError
        For an unknown time zone.

    Examples
    --------
    >>> two_oclock = np.array([1_656_640_800 * NS_PER_S])  # 1 July 2022, 02:00
    >>> utc_ns, known = to_utc(two_oclock, "Europe/Berlin", Notes())
    >>> (int(two_oclock[0] - utc_ns[0]) // NS_PER_S, bool(known[0]))
    (7200, True)
    """
    early, late = _offsets_at(local_ns, timezone)
    # Of the two offsets (PEP 495), the earlier is smaller in a skipped hour and larger in a
    # repeated one.
    missing, twice = early < late, early > late
    second, undecided = _second_pass(local_ns, twice)
    offset_s = np.where(second, late, early)
    notes.count(f"times that don't exist in {timezone}, left out", missing.sum())
    notes.count(f"times that come twice in {timezone}, left out", undecided.sum())
    return local_ns - offset_s * NS_PER_S, ~missing & ~undecided


def settled(local_ns: Int64Array, timezone: str) -> int:
    """Return how many of these times can be converted, whatever follows them.

    A repeated hour is resolved by its end. Until that is known, its times must wait, and the time
    before it too.
    """
    early, late = _offsets_at(local_ns, timezone)
    once = np.flatnonzero(early <= late)
    if once.size and once[-1] == local_ns.size - 1:
        return local_ns.size
    return int(once[-1]) if once.size else 0


def zone_of(name: str) -> ZoneInfo:
    """Look up a time zone by its IANA name.

    Raises
    ------
    UsageError
        If it is unknown.
    """
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise UsageError(
            f"no time zone {name!r}", "give an IANA name such as Europe/Berlin or UTC"
        ) from None


def _offsets_at(local_ns: Int64Array, timezone: str) -> tuple[Int64Array, Int64Array]:
    """UTC offsets (s, positive east) of the first and the second occurrence of each time."""
    zone = zone_of(timezone)
    quarters, index = np.unique(local_ns // QUARTER_NS, return_inverse=True)
    offsets = np.array([offsets_s(int(q), zone) for q in quarters], np.int64).reshape(-1, 2)
    return offsets[index, 0], offsets[index, 1]


def offsets_s(quarter: int, zone: ZoneInfo) -> tuple[int, int]:
    """UTC offsets (s, positive east) of the two occurrences of a quarter of an hour.

    They differ only if daylight saving skips or repeats it. ``quarter`` is local time since 1970.
    """
    local = _EPOCH + timedelta(seconds=quarter * 900)
    first, second = (local.replace(tzinfo=zone, fold=fold).utcoffset() for fold in (0, 1))
    return int((first or timedelta()).total_seconds()), int((second or timedelta()).total_seconds())


def _second_pass(local_ns: Int64Array, twice: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Return which times of a repeated hour are of its second pass, and which are ambiguous."""
    second, undecided = np.zeros_like(twice), np.zeros_like(twice)
    edges = np.flatnonzero(np.diff(twice, prepend=False, append=False))
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        back = np.flatnonzero(np.diff(local_ns[a:b]) < 0) + 1 + a
        if back.size == 1:
            second[back[0] : b] = True
        elif back.size > 1:
            undecided[a:b] = True
        else:
            before = local_ns[a] - local_ns[a - 1] if a > 0 else None
            after = local_ns[b] - local_ns[b - 1] if b < local_ns.size else None
            if before == after:
                undecided[a:b] = True
            else:
                second[a:b] = before is None or (after is not None and after < before)
    return second, undecided


class ClockChange(NamedTuple):
    """An hour from ``local_ns`` on that is 'skipped' or 'repeated', as in the zone ``zone``."""

    local_ns: int
    what: str
    zone: str


def find_jump(local_ns: Int64Array) -> ClockChange | None:
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
        others = sorted(available_timezones() - set(_USUAL))  # of which any will do
        zone = next((n for n in (*_USUAL, *others) if _does(ZoneInfo(n), what, quarter)), None)
        if zone is not None:
            return ClockChange(quarter * QUARTER_NS, what, zone)
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


def _does(zone: ZoneInfo, what: str, quarter: int) -> bool:
    """Whether a zone skips or repeats exactly the hour that begins with this quarter."""

    def is_so(at: int) -> bool:
        first, second = offsets_s(at, zone)
        return first < second if what == "skipped" else first > second

    return is_so(quarter) and is_so(quarter + 3) and not (is_so(quarter - 1) or is_so(quarter + 4))
