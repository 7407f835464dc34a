"""The time line of a recording: maps stream time to wall-clock log times.

A file may be processed ten times faster than real time. To keep video, rows and estimates aligned
at the stream's own speed, a message's log time is the arrival of its stream's first data plus the
stream time since then. A stream that runs in real time, as a camera's, is realigned to the wall
clock when the two differ, because the clock was set or one of them runs fast.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rsenf.messages import (
    Frame,
    Header,
    Health,
    IdleEstimate,
    Mark,
    MatchResult,
    ReferenceBlock,
    RowBlock,
    VideoPacket,
)

LATEST_NS = (1 << 64) - 1
REFERENCE = "reference/"
KEPT_STREAMS = 32  # for each source; each start or reconnection begins a new stream
# These arrive together with their data; others cover an interval, and arrive at its end.
MOMENTS = (Frame, VideoPacket, RowBlock)
# These refer to their whole stream so far: their stream time is always that of its first frame.
OF_ALL_SO_FAR = (IdleEstimate, MatchResult)
# A stream is realigned to a clock that differs by more than FAR_NS, after running in step with it
# for PACE_NS. A file that happens to be processed at nearly real time doesn't run in step.
FAR_NS, PACE_NS = 1_000_000_000, 30_000_000_000


class Timeline:
    """Assigns log times to messages.

    Parameters
    ----------
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    """

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        self._clock_ns = clock_ns
        self._sources: dict[str, dict[tuple[str, int], _Stream]] = {}

    def log_time_ns(self, cls: type[Any], header: Header) -> int:
        """Return the log time of a message, from 0 to 2⁶⁴ − 1."""
        if cls in (Health, ReferenceBlock) or header.source.startswith(REFERENCE):
            return _bounded(self._clock_ns())
        streams = self._sources.setdefault(header.source, {})
        stream = streams.get((header.run_id, header.epoch))
        arrival_ns = self.arrival_ns(header)
        if header.mark != Mark.DATA:
            # A mark has no stream time: it gets the latest log time of its stream.
            return stream.latest_ns if stream else arrival_ns
        if stream is None:
            if cls in OF_ALL_SO_FAR:
                return arrival_ns
            stream = streams[header.run_id, header.epoch] = _Stream(header.pts_ns, arrival_ns)
            if len(streams) > KEPT_STREAMS:
                del streams[next(iter(streams))]
        if cls in MOMENTS:
            stream.follow(header.pts_ns, arrival_ns)
        return stream.log_time_ns(header.pts_ns)

    def arrival_ns(self, header: Header) -> int:
        """Return the arrival time of the message's data; now if unknown."""
        return _bounded(header.arrival_time_ns or self._clock_ns())


class _Stream:
    """Offset from stream time to log time, and the latest log time so far."""

    def __init__(self, pts_ns: int, arrival_ns: int) -> None:
        self.latest_ns = 0
        self._offset_ns = self._tried_ns = arrival_ns - pts_ns
        self._tried_since_ns = pts_ns

    def log_time_ns(self, pts_ns: int) -> int:
        time_ns = _bounded(self._offset_ns + pts_ns)
        self.latest_ns = max(time_ns, self.latest_ns)
        return time_ns

    def follow(self, pts_ns: int, arrival_ns: int) -> None:
        """Realign to the clock, if it has run in step with the stream at a different offset."""
        offset_ns = arrival_ns - pts_ns
        if abs(offset_ns - self._tried_ns) > FAR_NS:
            self._tried_ns, self._tried_since_ns = offset_ns, pts_ns
        is_far = abs(self._tried_ns - self._offset_ns) > FAR_NS
        if is_far and pts_ns - self._tried_since_ns >= PACE_NS:
            self._offset_ns, self.latest_ns = self._tried_ns, 0


def _bounded(time_ns: int) -> int:
    return min(max(time_ns, 0), LATEST_NS)
