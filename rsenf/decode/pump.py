"""Waiting that can be interrupted: stop and pace, and a thread for calls that may block.

The thread fills a bounded queue, whose reader can time out.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from threading import Event
from typing import Generic, TypeVar

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


T = TypeVar("T")

# Queued pictures, beyond which backpressure stops the source. A consumer that leaves the queue full
# for this long will not catch up: the queue is dropped, or the latency would grow without limit.
_DEPTH = 64
_BEHIND_S = 3.0


class Disconnected(Exception):
    """A live source is absent or lost: the reason in one line, and perhaps a hint."""

    def __init__(self, reason: str, hint: str = "") -> None:
        super().__init__(reason)
        self.reason = reason
        self.hint = hint


class Stopped(Exception):
    """The caller has asked to stop."""


class Pump(Generic[T]):
    """Runs a generator in a separate thread.

    Calls of FFmpeg and OpenCV may block for long and can't be interrupted. Only this thread uses
    their objects, and it releases them when its call returns; the reader needn't wait for that.

    Parameters
    ----------
    produce : callable
        Returns the generator. Its exceptions are raised by :meth:`get`, after the items before
        them.
    stop : Stop
        Ends :meth:`get`, and the generator at its next item.
    can_begin : callable, optional
        Whether an item can be used without those before it, such as a key frame. After a drop, all
        items before the next such one are dropped as well.
    now_s : callable, optional
        A monotonic clock.
    depth : int, optional
        Length of the queue; a full queue blocks the generator.

    Attributes
    ----------
    may_drop : bool
        Whether items may be dropped. False until items are taken regularly, and for all sources
        that are not live: a full queue then blocks the source.
    skipped : int
        Number of items dropped before the one that :meth:`get` returned last.
    overrun : int
        Number of items dropped in all, before those that :meth:`get` has returned.
    """

    def __init__(
        self,
        produce: Callable[[], Iterator[T]],
        stop: Stop,
        can_begin: Callable[[T], bool] = lambda item: True,
        now_s: Callable[[], float] = time.monotonic,
        depth: int = _DEPTH,
    ) -> None:
        self._produce = produce
        self._stop = stop
        self._can_begin = can_begin
        self._now_s = now_s
        self._closed = threading.Event()
        self._queue: queue.Queue[tuple[T | Exception, int]] = queue.Queue(depth)
        self._full_since_s: float | None = None
        self._dropped = 0  # since the last item that was queued
        self.may_drop = False
        self.skipped = self.overrun = 0
        # A daemon thread: a call that hangs must not keep the process alive.
        threading.Thread(target=self._run, name="rsenf-decode-pump", daemon=True).start()

    def _run(self) -> None:
        try:
            for item in self._produce():
                if self._dropped and not self._can_begin(item):
                    self._dropped += 1
                elif not self._put(item):
                    return
        except Exception as exc:  # noqa: BLE001 - passed to the reader, which raises it
            self._put(exc)
        else:
            self._put(Disconnected("it ended the stream"))

    def _put(self, item: T | Exception) -> bool:
        """Queue an item, or drop it with the whole queue; return False when closed or stopped."""
        if not self._queue.full():
            self._full_since_s = None
        elif self._full_since_s is None and self.may_drop:
            self._full_since_s = self._now_s()
        while not self._closed.is_set() and not self._stop.is_set():
            if self._is_behind and not isinstance(item, Exception):
                self._drop_all()
                if not self._can_begin(item):
                    self._dropped += 1
                    return True
            try:
                self._queue.put((item, self._dropped), timeout=POLL_S)
            except queue.Full:
                continue
            self._dropped = 0
            return True
        return False

    @property
    def _is_behind(self) -> bool:
        return self._full_since_s is not None and self._now_s() - self._full_since_s > _BEHIND_S

    def _drop_all(self) -> None:
        """Empty the queue."""
        self._full_since_s = None
        while True:
            try:
                _, before = self._queue.get_nowait()
            except queue.Empty:
                return
            self._dropped += 1 + before

    @property
    def waiting(self) -> int:
        """Number of items in the queue, or dropped since the last one that was queued."""
        return self._queue.qsize() + self._dropped

    def get(self, timeout_s: float) -> T:
        """Return the next item.

        Raises
        ------
        TimeoutError
            When none came in time.
        Stopped
            When asked to stop.
        Disconnected
            When the generator has ended.
        """
        end_s = time.monotonic() + timeout_s
        while not self._stop.is_set():
            remaining_s = end_s - time.monotonic()
            try:
                item, self.skipped = self._queue.get(timeout=max(0.0, min(POLL_S, remaining_s)))
            except queue.Empty:
                if remaining_s <= 0:
                    raise TimeoutError from None
                continue
            self.overrun += self.skipped
            if isinstance(item, Exception):
                raise item
            return item
        raise Stopped

    def close(self) -> None:
        """End the generator at its next item, without waiting for it."""
        self._closed.set()
