"""When, by this host's clock, a picture was taken: arrival less what the way took at least.

A stream's own clock says how far pictures are apart, not what the time is. Arrivals tell that, but
jitter: of the last minute the one that took least counts. The flicker tells how old pictures are
beyond that.
"""

from __future__ import annotations

from rsenf.messages import Header
from rsenf.timebase import ArrivalClock


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
        self._arrivals = ArrivalClock()
        self._begun_ns: int | None = None  # arrival of the first picture of all

    def begin(self, header: Header) -> None:
        """Begin an epoch: the stream's clock may have been set anew."""
        self._arrivals = ArrivalClock()
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
        self._arrivals.note(header.pts_ns, header.arrival_time_ns or header.camera_time_ns)
        self._offset_ns = self._arrivals.offset_ns

    @property
    def offset_ns(self) -> int | None:
        """UTC less the stream's clock; None while it isn't known."""
        return self._offset_ns
