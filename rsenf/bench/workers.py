"""Processes that work through tasks side by side; a task is one process's from end to end."""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any, Protocol, TypeVar

from rsenf.errors import NodeFailed


class Task(Protocol):
    """What can be worked on: a clip, say."""

    @property
    def key(self) -> str:
        """Name that tells it from any other."""
        ...


T = TypeVar("T", bound=Task)
Work = Callable[[T], dict[str, Any]]


def work_all(tasks: Sequence[T], work: Work[T], jobs: int) -> Iterator[dict[str, Any]]:
    """Work through tasks in so many processes; yields each record as it is done.

    Closing the iterator, or an exception in its user, ends the processes at once.

    Parameters
    ----------
    tasks : sequence of Task
    work : callable
        From a task to its record; other processes import it by its name.
    jobs : int

    Raises
    ------
    NodeFailed
        When a process dies, or a task can't be done.
    """
    # A fresh interpreter each: a fork would share the threads' locks of FFmpeg and OpenCV.
    context = multiprocessing.get_context("spawn")
    left = list(reversed(tasks))
    processes: dict[Connection, Any] = {}
    busy: dict[Connection, T] = {}
    try:
        for _ in range(min(jobs, len(tasks))):
            ours, theirs = context.Pipe()
            processes[ours] = context.Process(target=_work, args=(theirs, work), daemon=True)
            processes[ours].start()
            theirs.close()
            _give(ours, left.pop(), busy)
        while busy:
            for ready in wait(list(busy)):
                assert isinstance(ready, Connection)
                record = _received(ready, busy.pop(ready))
                if left:
                    _give(ready, left.pop(), busy)
                yield record
    finally:
        for connection, process in processes.items():
            connection.close()
            process.terminate()
            process.join()


def _give(connection: Connection, task: T, busy: dict[Connection, T]) -> None:
    connection.send(task)
    busy[connection] = task


def _received(connection: Connection, task: Task) -> dict[str, Any]:
    try:
        record, trouble = connection.recv()
    except EOFError:
        raise NodeFailed(
            f"the process that worked on '{task.key}' died", "not enough memory? try --jobs 1"
        ) from None
    if trouble:
        raise NodeFailed(f"'{task.key}' can't be done: {trouble}")
    assert isinstance(record, dict)
    return record


def _work(connection: Connection, work: Work[Any]) -> None:
    """Work on what comes, until nothing more does."""
    # Ctrl-C reaches every process of a terminal; the parent ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    import cv2

    cv2.setNumThreads(1)
    while True:
        try:
            task = connection.recv()
        except EOFError:
            return
        try:
            connection.send((work(task), ""))
        except Exception as exc:  # noqa: BLE001  # told to the parent, which stops the run
            traceback.print_exc()
            connection.send((None, f"{type(exc).__name__}: {exc}"))
