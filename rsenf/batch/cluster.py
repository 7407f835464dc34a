"""Workers of an existing Dask cluster in place of processes of our own."""

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
_LOOK_S = 0.25  # how often it is looked for what takes too long; workers tell every half second
_RESTART_S = 60.0


def worked_on_cluster(
    tasks: Sequence[T],
    work: Work[T],
    address: str,
    tell: Callable[[str], None],
    timeout_s: float = math.inf,
) -> Iterator[Done[T]]:
    """Work through tasks on a cluster; yields each once, as it is done.

    What a dead worker had is done by another one, as often as the scheduler allows
    (``distributed.scheduler.allowed-failures``). Closing the iterator, or an exception in its user,
    takes back what isn't begun.

    Parameters
    ----------
    tasks : sequence
    work : callable
        From a task to its answer; workers import it by its name.
    address : str
        Of the scheduler.
    tell : callable
        Told in words what keeps the work from beginning.
    timeout_s : float, optional
        How long a task may take once a worker has begun it; then it is taken back, and the worker
        restarted by its nanny: nothing less ends a task. What else that worker had is done again.

    Raises
    ------
    UsageError
        Without Dask, for a scheduler that can't be reached, or workers with another rsenf; with a
        timeout, for workers that nobody would restart.
    NodeFailed
        When the scheduler is lost.
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
        except OSError as exc:  # of a question that the scheduler doesn't answer any more
            raise _lost() from exc


def _worked(
    distributed: Any, client: Any, left: deque[T], work: Work[T], timeout_s: float
) -> Iterator[Done[T]]:
    """Hand tasks out, and yield what becomes of them."""
    given = dict[str, tuple[Any, T]]()
    running = distributed.as_completed(loop=client.loop)
    late: dict[str, _Known] = {}

    def give() -> None:
        # No more than can be worked on: what waits beside a deadly task is blamed with it.
        while left and len(given) < max(1, sum(client.nthreads().values())):
            future = client.submit(answered, left[0], work, pure=False)
            given[future.key] = future, left.popleft()
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
    """What the scheduler knows of a task: whom it killed, who has it, and for how long."""

    deaths: int
    worker: str
    begun_s: float


def _known(keys: list[str], dask_scheduler: Any) -> dict[str, _Known]:
    """Return it; Dask has the scheduler run this, which is given by the argument's name."""
    found = {}
    for key in keys:
        if task := dask_scheduler.tasks.get(key):
            has = task.processing_on
            begun_s = has.executing.get(task, 0.0) if has else 0.0
            found[key] = _Known(task.suspicious, has.address if has else "", begun_s)
    return found


def _taken_back(client: Any, futures: dict[str, Any], timeout_s: float) -> dict[str, _Known]:
    """Take back what takes too long, and have its workers restarted; return what it was."""
    known = client.run_on_scheduler(_known, keys=list(futures))
    late = {key: one for key, one in known.items() if one.begun_s > timeout_s}
    if late:
        client.cancel([futures[key] for key in late])  # first, or another worker would get it
        workers = sorted({one.worker for one in late.values()})
        client.restart_workers(workers, timeout=_RESTART_S, raise_for_error=False)
    return late


def _connected(distributed: Any, address: str) -> Any:
    # What is lost is said once, by us; it would come with tracebacks.
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
    """Refuse workers that nobody would start again."""
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
    """Return what has become of a task."""
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
