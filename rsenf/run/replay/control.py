"""What a player is told while it plays: pause, step, seek, stop."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Condition, Event

from rsenf.timebase import NS_PER_S

POLL_S = 0.05
# Frames that were coded in another order go back in time by less than this.
REORDERED_NS = 2 * NS_PER_S


class Control:
    """Tells a player what to do. May be used from any thread.

    Parameters
    ----------
    stop : Event, optional
        Ends the playing when it is set.
    """

    def __init__(self, stop: Event | None = None) -> None:
        self.stop = stop or Event()
        self.paused = False
        self._steps = 0
        self._seek_s: float | None = None
        self._change = Condition()

    def pause(self) -> None:
        """Pause, or go on."""
        with self._change:
            self.paused = not self.paused
            self._steps = 0
            self._change.notify_all()

    def step(self) -> None:
        """Pause, and let one more message pass."""
        with self._change:
            self._steps += self.paused
            self.paused = True
            self._change.notify_all()

    def seek(self, by_s: float) -> None:
        """Go on from a place so many seconds later, or earlier."""
        with self._change:
            self._seek_s = (self._seek_s or 0.0) + by_s
            self._change.notify_all()

    def sought_s(self) -> float | None:
        """Take the seconds to seek by; None when nothing is sought."""
        with self._change:
            seek_s, self._seek_s = self._seek_s, None
            return seek_s

    def admit(self, left_s: Callable[[], float]) -> bool:
        """Wait until a message may pass; False when the player is to seek or stop instead.

        Parameters
        ----------
        left_s : callable
            How long until the message is due, were there no pauses.
        """
        with self._change:
            while not self.stop.is_set() and self._seek_s is None:
                if self._steps:
                    self._steps -= 1
                    return True
                left = POLL_S if self.paused else left_s()
                if left <= 0:
                    return True
                self._change.wait(min(left, POLL_S))
            return False


class Pace:
    """When what was recorded at some time is due.

    Where time goes back, because passes were recorded beside each other, it begins anew.

    Parameters
    ----------
    rate : float
        Recorded seconds in a second; 0 for as fast as whoever listens takes it.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._anchor: tuple[float, int] | None = None
        self._latest_ns = 0

    def restart(self) -> None:
        """Let the next message be due now."""
        self._anchor = None

    def left_s(self, time_ns: int) -> float:
        """Seconds until a time is due; below 0 when it is late."""
        if not self._rate:
            return 0.0
        now_s = time.monotonic()
        if self._anchor is None or time_ns < self._latest_ns - REORDERED_NS:
            self._anchor, self._latest_ns = (now_s, time_ns), time_ns
        self._latest_ns = max(self._latest_ns, time_ns)
        begun_s, begun_ns = self._anchor
        return begun_s + (time_ns - begun_ns) / NS_PER_S / self._rate - now_s
