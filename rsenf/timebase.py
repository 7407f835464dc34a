"""The three clocks of a recording, and the time of a row.

A frame has up to three times, all in integer nanoseconds:

``pts_ns``
    The stream's presentation time, with an arbitrary zero: from the container, the RTP packets or
    the camera's driver. Where there is none, frames are counted (``Header.rate_basis`` says so),
    or dated on arrival. All signal processing uses only this clock.
``camera_time_ns``
    The camera's wall clock (UTC since 1970), if the stream has it; 0 means "unknown".
``arrival_time_ns``
    This host's wall clock when the frame arrived; it differs from run to run.

Rows of a frame are exposed one after another: row ``l`` begins ``l`` line times after row 0.
"""

from __future__ import annotations

from collections import deque
from fractions import Fraction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datetime import datetime

NS_PER_S = 1_000_000_000
# Warning for times without a time zone, which are taken as UTC.
NO_ZONE = "zone unknown: by whole hours uncertain"
ARRIVAL_MEMORY_NS = 60 * NS_PER_S


def pts_to_ns(pts: int, time_base: Fraction) -> int:
    """Convert a presentation time to ns, rounded to nearest, without floating point.

    Parameters
    ----------
    pts : int
        Presentation time in ticks.
    time_base : Fraction
        Seconds per tick, for example 1/90000 or 1001/30000.

    Examples
    --------
    >>> pts_to_ns(2, Fraction(1001, 30000))
    66733333
    """
    numerator = 2 * pts * time_base.numerator * NS_PER_S + time_base.denominator
    return numerator // (2 * time_base.denominator)


def seconds(t_ns: int) -> float:
    """Convert nanoseconds to seconds.

    >>> seconds(1_500_000_000)
    1.5
    """
    return t_ns / NS_PER_S


def nanoseconds(t_s: float) -> int:
    """Convert seconds to nanoseconds, rounded to nearest."""
    return round(t_s * NS_PER_S)


def since_1970_ns(moment: datetime) -> int:
    """Convert a datetime to ns since 1970; UTC is assumed without a time zone."""
    from datetime import UTC, datetime, timedelta

    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000


def utc_text(t_ns: int) -> str | None:
    """Format a time as ISO 8601 with milliseconds; None if unknown (0).

    Examples
    --------
    >>> utc_text(1_768_435_200_500_000_000)
    '2026-01-15T00:00:00.500Z'
    """
    if not t_ns:
        return None
    from datetime import UTC, datetime

    moment = datetime.fromtimestamp(t_ns // NS_PER_S, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{t_ns % NS_PER_S // 10**6:03d}Z"


class ArrivalClock:
    """Estimates the offset from a stream's clock to the wall clock from arrival times.

    It is the minimum of arrival minus stream time over the last minute (minimum filter, as in clock
    synchronisation): delays are never negative, and some messages arrive almost without any.
    """

    def __init__(self) -> None:
        self._offsets: deque[tuple[int, int]] = deque()  # stream clock and offset, both increasing

    def note(self, pts_ns: int, arrival_ns: int) -> None:
        """Note the arrival of data.

        Parameters
        ----------
        pts_ns : int
            Its time on the stream's clock.
        arrival_ns : int
            Its arrival on the wall clock; 0 (unknown) is ignored.
        """
        offsets, offset_ns = self._offsets, arrival_ns - pts_ns
        if not arrival_ns:
            return
        while offsets and offsets[-1][1] >= offset_ns:
            offsets.pop()
        offsets.append((pts_ns, offset_ns))
        while offsets[0][0] < pts_ns - ARRIVAL_MEMORY_NS:
            offsets.popleft()

    @property
    def offset_ns(self) -> int | None:
        """Wall clock minus stream's clock, ns; None without any arrival time."""
        return self._offsets[0][1] if self._offsets else None
