"""Alarm triggers of an archive, which keeps the minutes around each: a message, or SIGUSR1."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rsenf.bus.inbox import Received
from rsenf.bus.keys import matches
from rsenf.messages import Mark
from rsenf.record.archive import ArchiveRecorder
from rsenf.record.writer import Recorder


class AlarmWatch:
    """Reports alarms to an archive. A single-file recording keeps everything, so it needs none.

    Parameters
    ----------
    sink : Recorder or ArchiveRecorder
        The open recording.
    key_expr : str
        Messages of these keys are alarms, unless their ``active`` is false.
    """

    def __init__(self, sink: Recorder | ArchiveRecorder, key_expr: str) -> None:
        self._archive = sink if isinstance(sink, ArchiveRecorder) else None
        # To be subscribed to.
        self.key_exprs = (key_expr,) if self._archive else ()
        self._is_trigger: dict[str, bool] = {}
        self._asked = threading.Event()

    def note(self, received: Received) -> None:
        """Check a recorded message; raise the alarm if it triggers one."""
        key, message = received.key, received.message
        if key not in self._is_trigger:
            self._is_trigger[key] = any(matches(expr, key) for expr in self.key_exprs)
        alarming = message.header.mark == Mark.DATA and getattr(message, "active", True)
        if self._archive and self._is_trigger[key] and alarming:
            self._archive.alarm(key, " ".join(filter(None, (key, getattr(message, "text", "")))))

    def check(self) -> None:
        """Raise the alarm that a signal has requested since the last call."""
        if self._archive and self._asked.is_set():
            self._asked.clear()
            self._archive.alarm(None, "SIGUSR1")

    @contextmanager
    def on_signal(self) -> Iterator[None]:
        """Make SIGUSR1 an alarm of all cameras. Does nothing outside the main thread."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = signal.signal(signal.SIGUSR1, lambda *_: self._asked.set())
        try:
            yield
        finally:
            signal.signal(signal.SIGUSR1, before)
