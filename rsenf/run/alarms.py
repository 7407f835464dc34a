"""What makes an archive keep the minutes about it: a message, or a signal."""

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
    """Tells an archive of alarms. A recording that is a single file keeps everything anyway.

    Parameters
    ----------
    sink : Recorder or ArchiveRecorder
        What is recorded to.
    key_expr : str
        Whose messages are alarms, but for those that say that one is no longer active.
    """

    def __init__(self, sink: Recorder | ArchiveRecorder, key_expr: str) -> None:
        self._archive = sink if isinstance(sink, ArchiveRecorder) else None
        # What has to be received for it.
        self.key_exprs = (key_expr,) if self._archive else ()
        self._is_trigger: dict[str, bool] = {}
        self._asked = threading.Event()

    def note(self, received: Received) -> None:
        """Take in a message that was recorded."""
        key, message = received.key, received.message
        if key not in self._is_trigger:
            self._is_trigger[key] = any(matches(expr, key) for expr in self.key_exprs)
        alarming = message.header.mark == Mark.DATA and getattr(message, "active", True)
        if self._archive and self._is_trigger[key] and alarming:
            self._archive.alarm(key, " ".join(filter(None, (key, getattr(message, "text", "")))))

    def check(self) -> None:
        """Do what a signal has asked for."""
        if self._archive and self._asked.is_set():
            self._asked.clear()
            self._archive.alarm(None, "SIGUSR1")

    @contextmanager
    def on_signal(self) -> Iterator[None]:
        """Let SIGUSR1 be an alarm of all cameras; only in the main thread, which signals reach."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = signal.signal(signal.SIGUSR1, lambda *_: self._asked.set())
        try:
            yield
        finally:
            signal.signal(signal.SIGUSR1, before)
