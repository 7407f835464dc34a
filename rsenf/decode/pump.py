"""A thread that reads what may hang, and a queue whose reader can give up on it."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from rsenf.decode.waiting import POLL_S, Stop

T = TypeVar("T")

# Pictures that may wait for a slow consumer; then the source is made to wait.
_DEPTH = 64


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
    """

    def __init__(self, produce: Callable[[], Iterator[T]], stop: Stop) -> None:
        self._produce = produce
        self._stop = stop
        self._closed = threading.Event()
        self._queue: queue.Queue[T | Exception] = queue.Queue(_DEPTH)
        # A daemon: a call that hangs must not keep the program from ending.
        threading.Thread(target=self._run, name="rsenf-decode-pump", daemon=True).start()

    def _run(self) -> None:
        try:
            for item in self._produce():
                if not self._put(item):
                    return
        except Exception as exc:  # noqa: BLE001 - handed to the reader, which raises it
            self._put(exc)
        else:
            self._put(Disconnected("it ended the stream"))

    def _put(self, item: T | Exception) -> bool:
        """Queue an item; False when nobody wants it any more."""
        while not self._closed.is_set() and not self._stop.is_set():
            try:
                self._queue.put(item, timeout=POLL_S)
            except queue.Full:
                continue
            return True
        return False

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
                item = self._queue.get(timeout=max(0.0, min(POLL_S, left_s)))
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
