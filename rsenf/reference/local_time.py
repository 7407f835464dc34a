"""Local times to UTC, through the hours that daylight saving skips and repeats."""

from __future__ import annotations

from datetime import datetime, timedelta
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.messages.schema import Int64Array
from rsenf.reference.notes import Notes
from rsenf.timebase import NS_PER_S

BoolArray = NDArray[np.bool_]

# Zones have changed their offset at whole quarters of an hour for a century.
QUARTER_NS = 900 * NS_PER_S
_EPOCH = datetime(1970, 1, 1)


def to_utc(local_ns: Int64Array, timezone: str, notes: Notes) -> tuple[Int64Array, BoolArray]:
    """Convert local times, in the order in which they were written down.

    An hour that comes twice is told apart by that order: the first pass up to the jump back, the
    second after it. A single pass belongs to the side that it is nearer to.

    Parameters
    ----------
    local_ns : ndarray of int64, shape (n,)
        Wall-clock time as if it were UTC since 1970.
    timezone : str
        IANA name.
    notes : Notes
        Told how many times could not be converted.

    Returns
    -------
    utc_ns : ndarray of int64, shape (n,)
    known : ndarray of bool, shape (n,)
        False for times that don't exist, or that could be either of two.

    Raises
    ------
    UsageError
        For an unknown time zone.
    """
    early, late = _offsets_at(local_ns, timezone)
    # In the hour that is skipped the offset of before is the smaller one, in one that is
    # repeated it is the larger (PEP 495).
    missing, twice = early < late, early > late
    second, undecided = _second_pass(local_ns, twice)
    offset_s = np.where(second, late, early)
    notes.count(f"times that don't exist in {timezone}, left out", missing.sum())
    notes.count(f"times that come twice in {timezone}, left out", undecided.sum())
    return local_ns - offset_s * NS_PER_S, ~missing & ~undecided


def settled(local_ns: Int64Array, timezone: str) -> int:
    """How many of these times can be converted, whatever follows them.

    A repeated hour is told apart by where it ends: one that is still open waits, together with
    the time before it.
    """
    early, late = _offsets_at(local_ns, timezone)
    once = np.flatnonzero(early <= late)
    if once.size and once[-1] == local_ns.size - 1:
        return local_ns.size
    return int(once[-1]) if once.size else 0


def zone_of(name: str) -> ZoneInfo:
    """Look up a time zone.

    Raises
    ------
    UsageError
        For an unknown one.
    """
    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise UsageError(
            f"no time zone {name!r}", "give an IANA name such as Europe/Berlin or UTC"
        ) from None


def _offsets_at(local_ns: Int64Array, timezone: str) -> tuple[Int64Array, Int64Array]:
    """Offsets in seconds east for the first and the second time that each time comes."""
    zone = zone_of(timezone)
    quarters, index = np.unique(local_ns // QUARTER_NS, return_inverse=True)
    offsets = np.array([offsets_s(int(q), zone) for q in quarters], np.int64).reshape(-1, 2)
    return offsets[index, 0], offsets[index, 1]


def offsets_s(quarter: int, zone: ZoneInfo) -> tuple[int, int]:
    """Offsets in seconds east for the first and the second time that a quarter of an hour comes."""
    local = _EPOCH + timedelta(seconds=quarter * 900)
    first, second = (local.replace(tzinfo=zone, fold=fold).utcoffset() for fold in (0, 1))
    return int((first or timedelta()).total_seconds()), int((second or timedelta()).total_seconds())


def _second_pass(local_ns: Int64Array, twice: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Tell which times of a repeated hour are of its second pass, and which can't be told."""
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
