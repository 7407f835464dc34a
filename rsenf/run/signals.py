"""Ctrl-C: once to stop in order, twice to stop at once."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from rsenf.errors import EXIT_INTERRUPTED


@contextmanager
def interruptible(at_once: Callable[[], None]) -> Iterator[threading.Event]:
    """Turn the first SIGINT or SIGTERM into an event, the second into ``at_once`` and exit 130."""
    stop = threading.Event()

    def handle(_number: int, _frame: FrameType | None) -> None:
        if stop.is_set():
            at_once()
            os._exit(EXIT_INTERRUPTED)
        stop.set()

    before = {s: signal.signal(s, handle) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
