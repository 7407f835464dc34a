"""Workers of an existing Dask cluster in place of processes of our own."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from rsenf import __version__
from rsenf.batch.pool import Done, Trouble, Work, answered
from rsenf.errors import NodeFailed, UsageError

T = TypeVar("T")
_CONNECT_S = 10.0


def worked_on_cluster(
    tasks: Sequence[T], work: Work[T], address: str, tell: Callable[[str], None]
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

    Raises
    ------
    UsageError
        Without Dask, for a scheduler that can't be reached, or workers with another rsenf.
    NodeFailed
        When the scheduler is lost.
    """
    try:
        import distributed
    except ImportError as exc:
        raise UsageError("--scheduler needs Dask", "pip install 'rsenf[dask]'") from exc
    with _connected(distributed, address) as client:
        _check_workers(client, tell)
        left, given = deque(tasks), dict[str, T]()
        running = distributed.as_completed(loop=client.loop)

        def give() -> None:
            # No more than can be worked on: what waits beside a deadly task is blamed with it.
            while left and len(given) < max(1, sum(client.nthreads().values())):
                future = client.submit(answered, left[0], work, pure=False)
                given[future.key] = left.popleft()
                running.add(future)

        give()
        for future in running:
            yield _done(distributed, future, given.pop(future.key))
            give()


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


def _version() -> str:
    return __version__


def _done(distributed: Any, future: Any, task: T) -> Done[T]:
    """Return what has become of a task."""
    if future.status == "finished":
        return Done(task, future.result(), None)
    if future.status != "error":
        raise NodeFailed(
            "the Dask scheduler is lost, or has let go of the batch", "the same command goes on"
        )
    problem = future.exception()
    if isinstance(problem, distributed.KilledWorker):
        tries = problem.allowed_failures + 1
        return Done(task, Trouble(f"{tries} workers died while they worked on it", True), tries)
    return Done(task, Trouble(f"{type(problem).__name__}: {problem}"), None)
