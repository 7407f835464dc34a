"""When, by this host's clock, a picture was taken: arrival less what the way took at least.

A stream's own clock says how far pictures are apart, not what the time is. Arrivals tell that, but
jitter: of the last minute the one that took least counts. The flicker tells how old pictures are
beyond that.
"""

from __future__ import annotations

from collections import deque

from rsenf.messages import Header
from rsenf.timebase import nanoseconds

SPAN_NS = nanoseconds(60.0)


class HostTime:
    """Offset from a stream's clock to UTC.

    Parameters
    ----------
    start_utc_ns : int
        When the first picture was taken, for recordings and simulations; 0 to go by arrival, and
        where that isn't known by the camera's own clock.
    """

    def __init__(self, start_utc_ns: int = 0) -> None:
        self._start_ns = start_utc_ns
        self._offset_ns: int | None = None
        self._least: deque[tuple[int, int]] = deque()  # time and offset, both rising
        self._begun_ns: int | None = None  # arrival of the first picture of all

    def begin(self, header: Header) -> None:
        """Begin an epoch: the stream's clock may have been set anew."""
        self._least.clear()
        self._offset_ns = None
        if not self._start_ns:
            return
        if self._begun_ns is None:
            self._begun_ns = header.arrival_time_ns
        since_ns = header.arrival_time_ns - self._begun_ns
        self._offset_ns = self._start_ns + since_ns - header.pts_ns

    def add(self, header: Header) -> None:
        """Take in when something arrived, or what the camera's clock said."""
        if self._start_ns:
            return
        came_ns = header.arrival_time_ns or header.camera_time_ns
        if not came_ns:
            return
        offset_ns = came_ns - header.pts_ns
        while self._least and self._least[-1][1] >= offset_ns:
            self._least.pop()
        self._least.append((header.pts_ns, offset_ns))
        while self._least[0][0] < header.pts_ns - SPAN_NS:
            self._least.popleft()
        self._offset_ns = self._least[0][1]

    @property
    def offset_ns(self) -> int | None:
        """UTC less the stream's clock; None while it isn't known."""
        return self._offset_ns
