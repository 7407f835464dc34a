"""A thread that reads what may hang, and a queue whose reader can give up on it."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from rsenf.decode.waiting import POLL_S, Stop

T = TypeVar("T")

# Pictures that may wait for a slow consumer; then the source is made to wait. One that stays behind
# for so long will not catch up: what waits is dropped, or pictures would come later and later.
_DEPTH = 64
_BEHIND_S = 3.0


class Disconnected(Exception):
    """A live source is not there, or no more: in one line why, and perhaps what to do."""

    def __init__(self, reason: str, hint: str = "") -> None:
        super().__init__(reason)
        self.reason = reason
        self.hint = hint


class Stopped(Exception):
    """The caller has asked to stop."""


class Pump(Generic[T]):
    """Runs a generator in a thread of its own.

    FFmpeg and OpenCV can block in one call for longer than anybody wants to wait, and neither can
    be interrupted. The thread alone touches their objects, and lets go of them when its call
    returns; whoever reads the queue needn't wait for that.

    Parameters
    ----------
    produce : callable
        Returns the generator. What it raises is raised by :meth:`get`, after the items before it.
    stop : Stop
        Ends :meth:`get`, and the generator at its next item.
    can_begin : callable, optional
        Whether nothing before an item is needed to go on with it. After a drop all others are
        dropped, too, up to one.
    now_s : callable, optional
        A steady clock.
    depth : int, optional
        Items that may wait; then the generator is made to.

    Attributes
    ----------
    may_drop : bool
        Off until somebody takes items regularly: before that, the source waits. It always waits
        where nothing is live.
    skipped : int
        Items that were dropped before the one that :meth:`get` returned last.
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
        self.skipped = 0
        # A daemon: a call that hangs must not keep the program from ending.
        threading.Thread(target=self._run, name="rsenf-decode-pump", daemon=True).start()

    def _run(self) -> None:
        try:
            for item in self._produce():
                if self._dropped and not self._can_begin(item):
                    self._dropped += 1
                elif not self._put(item):
                    return
        except Exception as exc:  # noqa: BLE001 - handed to the reader, which raises it
            self._put(exc)
        else:
            self._put(Disconnected("it ended the stream"))

    def _put(self, item: T | Exception) -> bool:
        """Queue an item, or drop it with all that waits; False when nobody wants any more."""
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
        """Drop what waits."""
        self._full_since_s = None
        while True:
            try:
                _, before = self._queue.get_nowait()
            except queue.Empty:
                return
            self._dropped += 1 + before

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
            left_s = end_s - time.monotonic()
            try:
                item, self.skipped = self._queue.get(timeout=max(0.0, min(POLL_S, left_s)))
            except queue.Empty:
                if left_s <= 0:
                    raise TimeoutError from None
                continue
            if isinstance(item, Exception):
                raise item
            return item
        raise Stopped

    def close(self) -> None:
        """Let the generator end at its next item, without waiting for it."""
        self._closed.set()
