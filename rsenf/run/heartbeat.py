"""Heartbeat of a node process: what its supervisor's watchdog goes by.

A node's health goes over the bus, where a slow reader holds it up by backpressure with everything
else that its senders send. The heartbeat goes through a pipe of its own, and stops only with the
process. It carries the node's progress.
"""

from __future__ import annotations

import contextlib
import os
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from rsenf.config.node_kind import Restart
from rsenf.errors import EXIT_FAILED
from rsenf.run.process import TRIM_S, end_process, trim_heap

BEAT_S = 0.25
ALONE_S = 10.0  # time limit to end in once the parent process is gone
# Extra time until a node's first health message: loading libraries is slow on a busy machine.
FIRST_WORD_S = 60.0
PIPE = "RSENF_HEARTBEAT"  # variable that names its pipe to an external program
_LAYOUT = struct.Struct("<3Q")
_MOST_BYTES = 1 << 16  # capacity of a pipe


class Progress(NamedTuple):
    """Messages that a node has taken and sent, and how many wait in it."""

    messages_in: int
    messages_out: int
    waiting: int


class Heartbeat:
    """The supervisor's end of a node's heartbeat.

    Attributes
    ----------
    writer : int
        Descriptor for the process to inherit, as long as :meth:`inherited` lasts.
    is_sent : bool
        Whether the process sends it; of an external program, whether it has.
    """

    def __init__(self, *, is_sent: bool = True) -> None:
        self.is_sent = is_sent
        reader, self.writer = os.pipe()
        self._reader = os.fdopen(reader, "rb", buffering=0)
        for descriptor in (reader, self.writer):
            os.set_blocking(descriptor, False)

    @contextmanager
    def inherited(self) -> Iterator[int]:
        """Keep the writing end open until the process has been started; yield it."""
        try:
            yield self.writer
        finally:
            os.close(self.writer)

    def newest(self) -> Progress | None:
        """Return the progress of the newest beat since the last call; None without any."""
        beats = self._reader.read(_MOST_BYTES) or b""
        self.is_sent |= bool(beats)
        return Progress(*_LAYOUT.unpack(beats[-_LAYOUT.size :])) if beats else None

    def close(self) -> None:
        """Close the pipe: the process has ended."""
        self._reader.close()


TIMES = "heard_s", "health_s", "moved_s", "idle_s"


class Pulse:
    """When a node was last heard of, and when it last made progress.

    Parameters
    ----------
    now_s : float
        Time of its start by a monotonic clock; any before it was started.

    Attributes
    ----------
    heard_s, health_s : float
        Time of its last heartbeat or health, and of its last health.
    moved_s : float
        When it last took or sent a message, or had none to take.
    idle_s : float
        When it last had none to take.
    reported_s, reported_dropped : float, int
        How far behind it was, and how many messages it had dropped, when last reported.
    """

    def __init__(self, now_s: float = 0.0) -> None:
        # Health and progress may take long at first.
        self.heard_s = self.health_s = self.moved_s = self.idle_s = now_s + FIRST_WORD_S
        self.reported_s, self.reported_dropped = 0.0, 0
        self._progress: Progress | None = None

    def note(self, progress: Progress, now_s: float) -> None:
        """Note the progress that a heartbeat, or else health, tells of."""
        self.heard_s = now_s
        if self._progress is None or not progress.waiting:
            self.idle_s = now_s
        if progress[:2] != (self._progress or ())[:2] or not progress.waiting:
            self.moved_s = now_s
        self._progress = progress

    def is_behind(self, now_s: float, for_s: float) -> bool:
        """Whether messages have waited in it all that time, so that it may hold up its senders."""
        return self._progress is not None and now_s - self.idle_s > for_s

    def shift(self, held_up_s: float) -> None:
        """Leave out a time in which the supervisor was held up."""
        for name in TIMES:
            setattr(self, name, getattr(self, name) + held_up_s)

    def begin_anew(self, now_s: float) -> None:
        """Count all time limits from now on, if not from later on already."""
        for name in TIMES:
            setattr(self, name, max(getattr(self, name), now_s))

    def is_silent(self, rule: Restart, now_s: float) -> bool:
        """Whether it has given no sign of life for too long."""
        return now_s - self.heard_s > rule.silent_s

    def is_stalled(self, rule: Restart) -> bool:
        """Whether messages wait, and it lives, but has taken and sent none for too long."""
        return self.heard_s - self.moved_s > rule.stalled_s

    def is_mute(self, rule: Restart) -> bool:
        """Whether its heart beats, but no health has come for too long."""
        return self.heard_s - self.health_s > rule.stalled_s


def name_of_pipe(descriptor: int) -> str:
    """Name a pipe to a process that may inherit it, by descriptor and inode."""
    return f"{descriptor}:{os.fstat(descriptor).st_ino}"


def inherited_pipe(name: str) -> int | None:
    """Return the descriptor of a pipe by its name; None if this process hasn't inherited it."""
    descriptor = int(name.partition(":")[0] or -1)
    with contextlib.suppress(OSError):
        if name_of_pipe(descriptor) == name:
            return descriptor
    return None


def send_beat(writer: int, progress: Progress) -> None:
    """Send a beat; never blocks. It is left out where the supervisor is behind, or gone."""
    with contextlib.suppress(OSError):
        os.write(writer, _LAYOUT.pack(*progress))


@contextmanager
def beating(
    progress: Callable[[], Progress], stop: threading.Event, supervisor: int, writer: int | None
) -> Iterator[None]:
    """Send the heartbeat, and watch the parent process, in a thread.

    Parameters
    ----------
    progress : callable
        Returns the node's progress.
    stop : Event
        Set when the parent process is gone. A process that doesn't end then, say because the bus is
        gone too and blocks it for ever, is ended.
    supervisor : int
        Process id of the parent; 0 not to watch it.
    writer : int or None
        Descriptor of the heartbeat, if the parent reads it.
    """
    alone_s, beats = 0.0, 0

    def beat() -> None:
        nonlocal alone_s, beats
        if writer is not None:
            send_beat(writer, progress())
        beats += 1
        if beats % round(TRIM_S / BEAT_S) == 0:
            trim_heap()
        if supervisor and os.getppid() != supervisor:
            stop.set()
            alone_s += BEAT_S
            if alone_s > ALONE_S:
                end_process(EXIT_FAILED)

    with regularly("heartbeat", beat):
        yield


@contextmanager
def regularly(name: str, call: Callable[[], None]) -> Iterator[None]:
    """Call a function, which may block, every ``BEAT_S`` in a thread of this name."""
    ended = threading.Event()

    def work() -> None:
        while not ended.wait(BEAT_S):
            call()

    thread = threading.Thread(target=work, name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
