"""The time line of a recording: stream time, laid onto the clock of the day.

A file may be processed ten times faster than it was filmed. So that video, rows and estimates
nevertheless lie beside each other at the stream's own speed, a message is logged at the arrival
of its stream's first data plus the stream time since then. A stream that keeps pace with the clock,
as a camera's does, follows it when the two part: the clock was set, or one of them runs fast.
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
KEPT_STREAMS = 32  # of a source; it begins another whenever it is started or connected anew
# These arrive when what they are of does; others are of a stretch of time, and arrive at its end.
MOMENTS = (Frame, VideoPacket, RowBlock)
# These are of all of their stream so far: their stream time is always that of its first frame.
OF_ALL_SO_FAR = (IdleEstimate, MatchResult)
# A clock this far from the time line is followed once it has kept pace with the stream for so long;
# a file that happens to be processed at nearly the speed of its filming doesn't.
FAR_NS, PACE_NS = 1_000_000_000, 30_000_000_000


class Timeline:
    """Finds the log time of messages.

    Parameters
    ----------
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    """

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        self._clock_ns = clock_ns
        self._sources: dict[str, dict[tuple[str, int], _Stream]] = {}

    def log_time_ns(self, cls: type[Any], header: Header) -> int:
        """Log time of a message, from 0 to 2⁶⁴ − 1."""
        if cls in (Health, ReferenceBlock) or header.source.startswith(REFERENCE):
            return _bounded(self._clock_ns())
        streams = self._sources.setdefault(header.source, {})
        stream = streams.get((header.run_id, header.epoch))
        arrival_ns = self.arrival_ns(header)
        if header.mark != Mark.DATA:
            # A mark has no stream time of its own: it goes where its stream has got to.
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
        """When the message's data arrived, or now where that isn't known."""
        return _bounded(header.arrival_time_ns or self._clock_ns())


class _Stream:
    """What to add to the time of a stream, and the latest log time so far."""

    def __init__(self, pts_ns: int, arrival_ns: int) -> None:
        self.latest_ns = 0
        self._offset_ns = self._tried_ns = arrival_ns - pts_ns
        self._tried_since_ns = pts_ns

    def log_time_ns(self, pts_ns: int) -> int:
        time_ns = _bounded(self._offset_ns + pts_ns)
        self.latest_ns = max(time_ns, self.latest_ns)
        return time_ns

    def follow(self, pts_ns: int, arrival_ns: int) -> None:
        """Go by the clock from here on, if that has kept pace at a distance."""
        offset_ns = arrival_ns - pts_ns
        if abs(offset_ns - self._tried_ns) > FAR_NS:
            self._tried_ns, self._tried_since_ns = offset_ns, pts_ns
        is_far = abs(self._tried_ns - self._offset_ns) > FAR_NS
        if is_far and pts_ns - self._tried_since_ns >= PACE_NS:
            self._offset_ns, self.latest_ns = self._tried_ns, 0


def _bounded(time_ns: int) -> int:
    return min(max(time_ns, 0), LATEST_NS)
