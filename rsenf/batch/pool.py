"""Runs tasks in local processes, or on the workers of an existing Dask cluster.

A process that dies costs only its task.
"""

from __future__ import annotations

import contextlib
import logging
import math
import multiprocessing
import signal
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, NamedTuple, TypeVar

from rsenf import __version__
from rsenf.errors import NodeFailed, RsenfError, UsageError

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


_CONNECT_S = 10.0
_LOOK_S = 0.25  # between checks for late tasks; workers report every 0.5 s
_RESTART_S = 60.0


def worked_on_cluster(
    tasks: Sequence[T],
    work: Work[T],
    address: str,
    tell: Callable[[str], None],
    timeout_s: float = math.inf,
) -> Iterator[Done[T]]:
    """Run tasks on a cluster; yields each once, when it is done.

    Tasks of a dead worker are given to another one, as often as the scheduler allows
    (``distributed.scheduler.allowed-failures``). Closing the iterator, or an exception in its user,
    cancels tasks that are not begun.

    Parameters
    ----------
    tasks : sequence
    work : callable
        From a task to its answer; workers import it by its name.
    address : str
        Of the scheduler.
    tell : callable
        Called with a text if something delays the start.
    timeout_s : float, optional
        Longest run time of a task on a worker; then it is cancelled and the worker restarted by its
        nanny, since nothing less ends a task. Other tasks of that worker are run again.

    Raises
    ------
    UsageError
        Without Dask, for an unreachable scheduler, or for workers with another rsenf; with a
        timeout, for workers without a nanny.
    NodeFailed
        If the scheduler is lost.
    """
    try:
        import distributed
    except ImportError as exc:
        raise UsageError("--scheduler needs Dask", "pip install 'rsenf[dask]'") from exc
    with _connected(distributed, address) as client:
        _check_workers(client, tell)
        if math.isfinite(timeout_s) and (alone := client.run_on_scheduler(_without_nanny)):
            raise UsageError(
                f"--timeout-s: the worker at {alone[0]} has no nanny to restart it",
                "start workers without --no-nanny, or leave the timeout out",
            )
        try:
            yield from _worked(distributed, client, deque(tasks), work, timeout_s)
        except OSError as exc:  # from a call to a scheduler that no longer answers
            raise _lost() from exc


def _worked(
    distributed: Any, client: Any, pending: deque[T], work: Work[T], timeout_s: float
) -> Iterator[Done[T]]:
    """Submit tasks, and yield their results."""
    given = dict[str, tuple[Any, T]]()
    running = distributed.as_completed(loop=client.loop)
    late: dict[str, _Known] = {}

    def give() -> None:
        # No more than can run: tasks that wait on a killed worker would be blamed as well.
        while pending and len(given) < max(1, sum(client.nthreads().values())):
            future = client.submit(answered, pending[0], work, pure=False)
            given[future.key] = future, pending.popleft()
            running.add(future)

    give()
    while given:
        for future in running.next_batch(block=not math.isfinite(timeout_s)):
            _, task = given.pop(future.key)
            if future.key in late:
                trouble = Trouble(f"not done within {timeout_s:g} s", died=True)
                yield Done(task, trouble, late[future.key].deaths + 1)
            else:
                yield _done(distributed, client, future, task)
            give()
        if math.isfinite(timeout_s):
            late |= _taken_back(client, {key: f for key, (f, _) in given.items()}, timeout_s)
            time.sleep(_LOOK_S)


class _Known(NamedTuple):
    """A task's state at the scheduler: worker deaths that it caused, its worker, its run time."""

    deaths: int
    worker: str
    begun_s: float


def _known(keys: list[str], dask_scheduler: Any) -> dict[str, _Known]:
    """Return the state of tasks; runs on the scheduler, which Dask passes as the last argument."""
    found = {}
    for key in keys:
        if task := dask_scheduler.tasks.get(key):
            has = task.processing_on
            begun_s = has.executing.get(task, 0.0) if has else 0.0
            found[key] = _Known(task.suspicious, has.address if has else "", begun_s)
    return found


def _taken_back(client: Any, futures: dict[str, Any], timeout_s: float) -> dict[str, _Known]:
    """Cancel tasks that take too long and restart their workers; return the state they had."""
    known = client.run_on_scheduler(_known, keys=list(futures))
    late = {key: one for key, one in known.items() if one.begun_s > timeout_s}
    if late:
        client.cancel([futures[key] for key in late])  # first, or another worker would get them
        workers = sorted({one.worker for one in late.values()})
        client.restart_workers(workers, timeout=_RESTART_S, raise_for_error=False)
    return late


def _connected(distributed: Any, address: str) -> Any:
    # A lost scheduler is reported once, here; Dask would add tracebacks.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        return distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as exc:
        raise UsageError(
            f"no Dask scheduler answers at {address}", "e.g. tcp://HOST:8786; is it running?"
        ) from exc


def _check_workers(client: Any, tell: Callable[[str], None]) -> None:
    """Refuse workers that have another rsenf, or none."""
    found = client.run(_version, on_error="return")
    for worker, version in found.items():
        if version != __version__:
            what = f"rsenf {version}" if isinstance(version, str) else f"no rsenf ({version})"
            raise UsageError(
                f"the worker at {worker} has {what}", f"install rsenf {__version__} there"
            )
    if not found:
        tell("the cluster has no workers yet; waiting for one")


def _without_nanny(dask_scheduler: Any) -> list[str]:
    return [worker.address for worker in dask_scheduler.workers.values() if not worker.nanny]


def _version() -> str:
    return __version__


def _done(distributed: Any, client: Any, future: Any, task: T) -> Done[T]:
    """Return the result of a task."""
    if future.status not in ("finished", "error"):
        raise _lost()
    known = client.run_on_scheduler(_known, keys=[future.key])
    tries = known[future.key].deaths + 1 if known else None
    if future.status == "finished":
        return Done(task, future.result(), tries)
    problem = future.exception()
    if isinstance(problem, distributed.KilledWorker):
        tries = problem.allowed_failures + 1
        return Done(task, Trouble(f"{tries} workers died while they worked on it", True), tries)
    return Done(task, Trouble(f"{type(problem).__name__}: {problem}"), tries)


def _lost() -> NodeFailed:
    return NodeFailed(
        "the Dask scheduler is lost, or has let go of the batch", "the same command goes on"
    )
