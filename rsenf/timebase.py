"""The three clocks of a recording, and the time of a row.

A frame has up to three times, all in integer nanoseconds:

``pts_ns``
    The stream's presentation clock: exact, from the container or the RTP packets, zero wherever
    the stream put it. All signal processing uses this clock and no other.
``camera_time_ns``
    The camera's wall clock (UTC since 1970), where the stream reveals it; 0 is "unknown".
``arrival_time_ns``
    This host's wall clock when the frame arrived; it differs from run to run.

Within a frame the rows follow each other: row ``l`` begins ``l`` line times after row 0.
"""

from __future__ import annotations

from collections import deque
from fractions import Fraction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from datetime import datetime

NS_PER_S = 1_000_000_000
# Of times that tell no zone where nobody said which: they are taken as UTC.
NO_ZONE = "zone unknown: by whole hours uncertain"
ARRIVAL_MEMORY_NS = 60 * NS_PER_S


def pts_to_ns(pts: int, time_base: Fraction) -> int:
    """Presentation time in ns, rounded to the nearest, without passing through floats.

    Parameters
    ----------
    pts : int
        Presentation time in ticks.
    time_base : Fraction
        Seconds per tick, for example 1/90000 or 1001/30000.
    """
    numerator = 2 * pts * time_base.numerator * NS_PER_S + time_base.denominator
    return numerator // (2 * time_base.denominator)


def seconds(t_ns: int) -> float:
    """Nanoseconds as seconds."""
    return t_ns / NS_PER_S


def nanoseconds(t_s: float) -> int:
    """Seconds as nanoseconds, rounded to the nearest."""
    return round(t_s * NS_PER_S)


def since_1970_ns(moment: datetime) -> int:
    """A moment as ns since 1970; UTC unless it tells its zone."""
    from datetime import UTC, datetime, timedelta

    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return (moment - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000


def utc_text(t_ns: int) -> str | None:
    """ISO 8601 with milliseconds; None for an unknown time."""
    if not t_ns:
        return None
    from datetime import UTC, datetime

    moment = datetime.fromtimestamp(t_ns // NS_PER_S, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{t_ns % NS_PER_S // 10**6:03d}Z"


def row_time_s(frame_time_s: float, row: int, rows: int, read_out_time_s: float) -> float:
    """Start of exposure of a row, relative to a rolling shutter's row 0.

    ``T_n + l · T_ro / L`` in the notation of the paper's Section III, where
    ``T_ro = (1 − ρ) / F_r`` for an idle ratio ``ρ``.
    """
    return frame_time_s + row * read_out_time_s / rows


class ArrivalClock:
    """What to add to a stream's clock for the clock of the day, by when its messages arrived.

    It is the least of what those of the last minute show: none arrives before it was taken, and
    some without delay.
    """

    def __init__(self) -> None:
        self._offsets: deque[tuple[int, int]] = deque()  # stream clock and offset, both rising

    def note(self, pts_ns: int, arrival_ns: int) -> None:
        """Take in that data of this time on the stream's clock arrived then; 0 is unknown."""
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
        """The least delay; None when nothing told when it arrived."""
        return self._offsets[0][1] if self._offsets else None
