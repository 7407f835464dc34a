"""Ctrl-C: once to stop in order, twice to stop at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interruptible(at_once: Callable[[], None]) -> Iterator[threading.Event]:
    """Turn the first SIGINT or SIGTERM into an event; the second calls ``at_once`` and interrupts.

    Raises
    ------
    KeyboardInterrupt
        At the second signal, so that everything is closed on the way out.
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
