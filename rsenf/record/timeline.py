"""The time line of a recording: stream time, laid onto the clock of the day.

A file may be processed ten times faster than it was filmed. So that video, rows and estimates
nevertheless lie beside each other at the stream's own speed, a message is logged at the arrival
of its stream's first data plus the stream time since then.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rsenf.messages import Header, Health, Mark, ReferenceBlock

LATEST_NS = (1 << 64) - 1
REFERENCE = "reference/"


class Timeline:
    """Finds the log time of messages.

    Parameters
    ----------
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    """

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        self._clock_ns = clock_ns
        # (source, epoch) -> what to add to its stream time, and the latest log time so far
        self._anchors: dict[tuple[str, int], int] = {}
        self._latest: dict[tuple[str, int], int] = {}

    def log_time_ns(self, cls: type[Any], header: Header) -> int:
        """Log time of a message, from 0 to 2⁶⁴ − 1."""
        if cls in (Health, ReferenceBlock) or header.source.startswith(REFERENCE):
            return _bounded(self._clock_ns())
        stream = (header.source, header.epoch)
        if header.mark != Mark.DATA:
            # A mark has no stream time of its own: it goes where its stream has got to.
            return self._latest.get(stream, self.arrival_ns(header))
        anchor = self._anchors.setdefault(stream, self.arrival_ns(header) - header.pts_ns)
        time_ns = _bounded(anchor + header.pts_ns)
        self._latest[stream] = max(time_ns, self._latest.get(stream, 0))
        return time_ns

    def arrival_ns(self, header: Header) -> int:
        """When the message's data arrived, or now where that isn't known."""
        return _bounded(header.arrival_time_ns or self._clock_ns())


def _bounded(time_ns: int) -> int:
    return min(max(time_ns, 0), LATEST_NS)
