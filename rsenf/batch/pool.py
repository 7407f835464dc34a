"""A pool of processes for tasks; a process that dies costs only its task."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import signal
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from rsenf.errors import RsenfError

T = TypeVar("T")
Work = Callable[[T], dict[str, Any]]
_LAST_BREATH_S = 2.0


@dataclass(frozen=True)
class Trouble:
    """Why a task has no answer.

    Parameters
    ----------
    text : str
        In one line.
    died : bool
        Whether the process died; otherwise it raised an exception.
    trace : str
        The exception's traceback.
    """

    text: str
    died: bool = False
    trace: str = ""


@dataclass(frozen=True)
class Done(Generic[T]):
    """A task with its answer or trouble; ``tries`` is None if unknown."""

    task: T
    answer: dict[str, Any] | Trouble
    tries: int | None


def worked(
    tasks: Sequence[T], work: Work[T], jobs: int, tries: int = 1, timeout_s: float = math.inf
) -> Iterator[Done[T]]:
    """Run tasks in ``jobs`` processes; yields each once, when it is done.

    Closing the iterator, or an exception in its user, ends the processes at once.

    Parameters
    ----------
    tasks : sequence
    work : callable
        From a task to its answer; other processes import it by its name.
    jobs : int
    tries : int, optional
        Number of processes that may die of a task. It is tried again last, when others need less
        memory.
    timeout_s : float, optional
        Longest run time of a task; then its process is killed, and it isn't tried again.
    """
    pending = deque((task, 1) for task in tasks)
    workers: list[_Worker[T]] = []
    try:
        while pending or any(worker.task for worker in workers):
            for worker in [w for w in workers if w.task is None][: len(pending)]:
                worker.give(*pending.popleft(), timeout_s)
            while pending and len(workers) < jobs:
                workers.append(_Worker(work))
                workers[-1].give(*pending.popleft(), timeout_s)
            for worker in _ready([worker for worker in workers if worker.task]):
                task, tried, answer = worker.answer()
                if isinstance(answer, Trouble) and answer.died:
                    workers.remove(worker)
                    if tried < tries and not worker.is_late:
                        pending.append((task, tried + 1))
                        continue
                yield Done(task, answer, tried)
    finally:
        for worker in workers:
            worker.end()


def _ready(workers: list[_Worker[T]]) -> list[_Worker[T]]:
    """Wait for workers that have an answer or are late."""
    by_connection = {worker.connection: worker for worker in workers}
    timeout_s = min(worker.due_s for worker in workers) - time.monotonic()
    answered = wait(list(by_connection), max(timeout_s, 0.0) if math.isfinite(timeout_s) else None)
    if answered:
        return [by_connection[one] for one in answered if isinstance(one, Connection)]
    return [worker for worker in workers if worker.give_up_if_late()]


class _Worker(Generic[T]):
    """A process and its current task."""

    def __init__(self, work: Work[T]) -> None:
        # A new interpreter each: a fork would copy locks held by threads of FFmpeg and OpenCV.
        context = multiprocessing.get_context("spawn")
        self.task: tuple[T, int] | None = None
        self.due_s, self.is_late = math.inf, False
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, work), daemon=True)
        self._process.start()
        theirs.close()

    def give(self, task: T, tried: int, timeout_s: float) -> None:
        """Send it a task; if it has died, that is found when its answer is read."""
        self.task, self._timeout_s = (task, tried), timeout_s
        self.due_s, self.is_late = time.monotonic() + timeout_s, False
        with contextlib.suppress(OSError):
            self.connection.send(task)

    def answer(self) -> tuple[T, int, dict[str, Any] | Trouble]:
        """Read its answer."""
        assert self.task is not None
        (task, tried), self.task = self.task, None
        try:
            return task, tried, self.connection.recv()
        except (EOFError, OSError):
            self._process.join(_LAST_BREATH_S)  # wait for its exit code before terminating it
            self.end()
            why = f"not done within {self._timeout_s:g} s" if self.is_late else ""
            return task, tried, Trouble(why or _death(self._process.exitcode), died=True)

    def give_up_if_late(self) -> bool:
        """Kill a process that takes too long; return whether it did."""
        self.is_late = time.monotonic() >= self.due_s
        if self.is_late:
            self._process.kill()
        return self.is_late

    def end(self) -> None:
        """Terminate the process."""
        self.connection.close()
        self._process.terminate()
        self._process.join()


def _death(exit_code: int | None) -> str:
    """Describe how a process died."""
    if exit_code is None or exit_code >= 0:
        return f"the process that worked on it ended by itself, with {exit_code}"
    try:
        name = signal.Signals(-exit_code).name
    except ValueError:
        name = f"signal {-exit_code}"
    return f"the process that worked on it was ended by {name}"


def _work(connection: Connection, work: Work[Any]) -> None:
    """Run tasks until the connection is closed."""
    # Ctrl-C reaches every process of a terminal; the parent ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(EOFError, OSError):  # the parent is gone
        while True:
            connection.send(answered(connection.recv(), work))


def answered(task: T, work: Work[T]) -> dict[str, Any] | Trouble:
    """Run a task; an exception becomes a :class:`Trouble`."""
    import cv2

    cv2.setNumThreads(1)
    try:
        return work(task)
    except Exception as exc:  # noqa: BLE001  # returned to the caller
        text = str(exc) if isinstance(exc, RsenfError) else f"{type(exc).__name__}: {exc}"
        return Trouble(text, trace=traceback.format_exc())
