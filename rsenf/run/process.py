"""The process that rsenf runs in: its end, Ctrl-C, memory, the host's clock, time limits.

A process that has used Zenoh ends by :func:`end_process`. Ctrl-C once stops in order, twice at
once (:func:`interruptible`). glibc's malloc keeps freed memory for reuse (:func:`keep_heap`), and
free memory between used blocks stays allocated too, tens of megabytes after a minute of higher
use: :func:`trim_heap` returns it now and then, at the cost of a few page faults. The host's wall
clock may be set by somebody (:class:`HostClock`). Time limits scale with the machine's speed,
measured by the start time of a process (:class:`Patience`).
"""

from __future__ import annotations

import _thread
import contextlib
import ctypes
import hashlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import NoReturn

from rsenf.bus.ring import ring_directory
from rsenf.timebase import NS_PER_S

# Longest wait for an answer: an exchange of graphs is over first, whose nodes have 20 s to leave.
ANSWER_S = 60.0


def end_process(code: int) -> NoReturn:
    """Flush stdout and stderr and exit at once. Call it after everything is closed.

    A normal exit can deadlock: the interpreter destroys Zenoh's objects while Zenoh's threads may
    still need the interpreter. One node in a hundred hung for ever.

    Parameters
    ----------
    code : int
        The exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    os._exit(code)


def set_by_signal(event: threading.Event) -> None:
    """Set an event from a signal handler: in a thread, as an event's lock is not reentrant.

    A handler runs between any two steps of the main thread, also within that thread's own
    ``event.wait``; if it holds the lock there, ``event.set`` would wait for ever.
    """
    _thread.start_new_thread(event.set, ())


@contextmanager
def interruptible(at_once: Callable[[], None] = lambda: None) -> Iterator[threading.Event]:
    """Turn the first SIGINT or SIGTERM into an event, which the ``with`` statement yields.

    Parameters
    ----------
    at_once : callable, optional
        Called at the second signal.

    Raises
    ------
    KeyboardInterrupt
        At the second signal, so that context managers are closed.
    """
    stop, asked = threading.Event(), False

    def handle(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        if asked or stop.is_set():
            at_once()
            raise KeyboardInterrupt
        asked = True
        set_by_signal(stop)

    before = {s: signal.signal(s, handle) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def hangups() -> Iterator[threading.Event]:
    """Turn SIGHUP into an event, which the ``with`` statement yields.

    Where it comes because the controlling terminal is gone, it is taken for SIGTERM; only once, as
    a shell and the kernel may both send it.
    """
    asked, had_terminal, closed = threading.Event(), has_terminal(), False

    def handle(_number: int, _frame: FrameType | None) -> None:
        nonlocal closed
        if not had_terminal or has_terminal():
            set_by_signal(asked)
        elif not closed:
            closed = True
            signal.raise_signal(signal.SIGTERM)

    before = signal.signal(signal.SIGHUP, handle)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGHUP, before)


def has_terminal() -> bool:
    """Return whether this process has a controlling terminal, wherever its words go."""
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY))
    except OSError:
        return False
    return True


def _reload_socket(graph: Path, pid: str) -> Path:
    """Return the socket of a process that runs a graph: of the file, whatever it was called by."""
    name = hashlib.sha256(os.fsencode(graph.resolve())).hexdigest()[:16]
    return ring_directory() / f"rsenf.reload-{name}-{pid}"


class ReloadRequests:
    """Hears :func:`ask_to_reload`, which waits for the answer.

    Parameters
    ----------
    graph : Path
        The graph file that this process runs.
    """

    def __init__(self, graph: Path) -> None:
        self._path = _reload_socket(graph, str(os.getpid()))
        self._socket = socket.socket(socket.AF_UNIX)
        self._asking: list[socket.socket] = []

    def __enter__(self) -> ReloadRequests:
        self._path.unlink(missing_ok=True)  # a killed process of the same number left it
        self._socket.bind(str(self._path))
        self._socket.listen()
        self._socket.setblocking(False)
        return self

    def __exit__(self, *error: object) -> None:
        self._path.unlink(missing_ok=True)
        for asking in (*self._asking, self._socket):
            asking.close()

    def pending(self) -> bool:
        """Return whether anybody waits for an answer."""
        with contextlib.suppress(BlockingIOError):
            while True:
                self._asking.append(self._socket.accept()[0])
        return bool(self._asking)

    def answer(self, text: str, *, accepted: bool) -> None:
        """Answer all that wait."""
        while self._asking:
            with self._asking.pop() as asking, contextlib.suppress(OSError):  # it may be gone
                asking.sendall(json.dumps([accepted, text]).encode())


def ask_to_reload(graph: Path) -> dict[int, tuple[bool, str]]:
    """Ask all processes on this host that run a graph to take its changed file.

    Parameters
    ----------
    graph : Path
        The graph file.

    Returns
    -------
    dict of int to (bool, str)
        By process number, whether it was accepted, and the answer in one line.
    """
    answers = {}
    for path in ring_directory().glob(_reload_socket(graph, "*").name):
        with socket.socket(socket.AF_UNIX) as asking, contextlib.suppress(PermissionError):
            asking.settimeout(ANSWER_S)
            try:
                asking.connect(str(path))
            except (ConnectionRefusedError, FileNotFoundError):  # its process was killed, or ended
                path.unlink(missing_ok=True)
                continue
            try:
                accepted, text = json.loads(asking.makefile("rb").read())
            except (OSError, ValueError):
                accepted, text = False, "not reloaded: it has ended, or doesn't answer"
            answers[int(path.name.rpartition("-")[2])] = bool(accepted), str(text)
    return answers


# Parameters of mallopt(3), from glibc's malloc.h. By default blocks of 128 kB and more are mapped
# and unmapped each time. The kernel then clears every page of an array of rows, or of a recording's
# chunk, anew, which takes as long as the work on it.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_LARGEST_KEPT, _KEPT = 4 << 20, 16 << 20
TRIM_S = 60.0  # interval of trim_heap


def keep_heap() -> None:
    """Serve blocks of up to 4 MiB from the heap, and keep up to 16 MiB free at its top.

    Larger blocks, as of a search, return to the system when freed. Does nothing without glibc.
    """
    with contextlib.suppress(OSError, AttributeError, TypeError):  # another C library, or none
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_M_MMAP_THRESHOLD, _LARGEST_KEPT)
        mallopt(_M_TRIM_THRESHOLD, _KEPT)


def trim_heap() -> None:
    """Return all free memory of the heap to the system. Does nothing without glibc."""
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


SET_NS = NS_PER_S // 2  # far above the time between reading the two clocks


class HostClock:
    """Returns the wall clock, UTC since 1970 in ns, and reports when it is set.

    Intervals are measured with the monotonic clock everywhere, so a step changes later arrival
    times but ends nothing.

    Parameters
    ----------
    on_set : callable
        Called with one line of text that says by how much the clock was set.
    wall_ns, steady_ns : callable
        The wall clock and a monotonic clock, in ns.
    """

    def __init__(
        self,
        on_set: Callable[[str], None],
        wall_ns: Callable[[], int] = time.time_ns,
        steady_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._on_set, self._wall_ns, self._steady_ns = on_set, wall_ns, steady_ns
        self._apart_ns = wall_ns() - steady_ns()

    def __call__(self) -> int:
        """Return the time."""
        now_ns = self._wall_ns()
        before_ns, self._apart_ns = self._apart_ns, now_ns - self._steady_ns()
        by_ns = self._apart_ns - before_ns
        if abs(by_ns) > SET_NS:
            self._on_set(f"this host's clock was set by {by_ns / NS_PER_S:+.1f} s")
        return now_ns


# What a node imports, and how long a process takes for it on an idle machine.
NODE, START_S = "import rsenf.run.node", 0.5
PAUSE_S = 0.02


def slowness() -> float:
    """Return how many times longer a process start takes now than on an idle machine; at least 1.

    Takes as long as it measures.
    """
    begun_s = time.monotonic()
    subprocess.run([sys.executable, "-c", NODE], check=True)
    return max(1.0, (time.monotonic() - begun_s) / START_S)


class Patience:
    """A time limit that is extended by :func:`slowness`, measured only once the limit is reached.

    Parameters
    ----------
    limit_s : float
        Time limit on an idle machine.
    """

    def __init__(self, limit_s: float) -> None:
        self._idle_s = limit_s
        self._begun_s = time.monotonic()
        self._end_s = self._begun_s + limit_s

    @property
    def left_s(self) -> float:
        """Seconds left, before any extension."""
        return self._end_s - time.monotonic()

    @property
    def over(self) -> bool:
        """Whether the time is over, even for a machine as slow as this one is now."""
        if self.left_s <= 0:
            self._end_s = max(self._end_s, self._begun_s + self._idle_s * slowness())
        return self.left_s <= 0


def wait_until(reached: Callable[[], bool], limit_s: float = 20.0) -> bool:
    """Wait for a condition; return whether it was reached in time.

    Parameters
    ----------
    reached : callable
        Polled every 20 ms.
    limit_s : float
        Time limit on an idle machine; a slower one gets more, see :class:`Patience`.
    """
    patience = Patience(limit_s)
    while not reached():
        if patience.over:
            return reached()  # measuring the slowness has taken a while
        time.sleep(PAUSE_S)
    return True
