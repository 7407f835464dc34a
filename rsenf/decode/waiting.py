"""Interruptible waiting, and pacing of frames in real time."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Event

from rsenf.timebase import NS_PER_S

# Interval of checking for a stop.
POLL_S = 0.05


class Stop:
    """Stop flag of one source: set by its ``close()`` or by the caller's event."""

    def __init__(self, outside: Event | None = None) -> None:
        self._closed = Event()
        self._outside = outside or self._closed

    def set(self) -> None:
        """Stop this source, but not others that share the caller's event."""
        self._closed.set()

    def is_set(self) -> bool:
        """Whether to stop."""
        return self._closed.is_set() or self._outside.is_set()

    def wait(self, timeout_s: float) -> bool:
        """Sleep until the timeout or a stop; return :meth:`is_set`."""
        end_s = time.monotonic() + timeout_s
        while not self.is_set() and (remaining_s := end_s - time.monotonic()) > 0:
            self._outside.wait(min(POLL_S, remaining_s))
        return self.is_set()


class Pacer:
    """Delays each frame until its time, counted from the first one.

    Parameters
    ----------
    now_s, sleep_s : callable
        A monotonic clock and a sleep function, in seconds.
    """

    def __init__(self, now_s: Callable[[], float], sleep_s: Callable[[float], object]) -> None:
        self._now_s = now_s
        self._sleep_s = sleep_s
        self._start: tuple[float, int] | None = None

    def wait_for(self, pts_ns: int) -> None:
        """Sleep until the frame with this presentation time is due, or return at once if late."""
        if self._start is None:
            self._start = self._now_s(), pts_ns
        start_s, start_ns = self._start
        late_s = self._now_s() - start_s - (pts_ns - start_ns) / NS_PER_S
        if late_s < 0:
            self._sleep_s(-late_s)
