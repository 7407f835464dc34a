"""Runs tasks on the workers of an existing Dask cluster instead of local processes."""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

from rsenf import __version__
from rsenf.batch.pool import Done, Trouble, Work, answered
from rsenf.errors import NodeFailed, UsageError

T = TypeVar("T")
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
        if math.isfinite(timeout_s):
            _check_nannies(client)
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


def _check_nannies(client: Any) -> None:
    """Refuse workers that can't be restarted."""
    if alone := client.run_on_scheduler(_without_nanny):
        raise UsageError(
            f"--timeout-s: the worker at {alone[0]} has no nanny to restart it",
            "start workers without --no-nanny, or leave the timeout out",
        )


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
