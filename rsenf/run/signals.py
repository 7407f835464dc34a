"""Handling of Ctrl-C: the first one stops in order, the second at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interruptible(at_once: Callable[[], None]) -> Iterator[threading.Event]:
    """Turn the first SIGINT or SIGTERM into an event, which the ``with`` statement yields.

    Parameters
    ----------
    at_once : callable
        Called at the second signal.

    Raises
    ------
    KeyboardInterrupt
        At the second signal, so that context managers are closed.
    """
    stop = threading.Event()

    def handle(_number: int, _frame: FrameType | None) -> None:
        if stop.is_set():
            at_once()
            raise KeyboardInterrupt
        stop.set()

    before = {s: signal.signal(s, handle) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
