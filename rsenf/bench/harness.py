"""Clips are worked through side by side; what can't be done ends the run.

A benchmark from its plan to its records: measures what the file of results lacks.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from rsenf.batch.journal import Journal, Record
from rsenf.batch.pool import Trouble, Work, worked
from rsenf.errors import NodeFailed


class Task(Protocol):
    """What can be worked on: a clip, say."""

    @property
    def key(self) -> str:
        """Name that tells it from any other."""
        ...


T = TypeVar("T", bound=Task)


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
    for done in worked(tasks, work, jobs):
        if not isinstance(done.answer, Trouble):
            yield done.answer
        elif done.answer.died:
            raise NodeFailed(
                f"'{done.task.key}' can't be done: {done.answer.text}",
                "not enough memory? try --jobs 1",
            )
        else:
            print(done.answer.trace, file=sys.stderr)
            raise NodeFailed(f"'{done.task.key}' can't be done: {done.answer.text}")


Progress = Callable[[int, int], None]


def measure_missing(
    tasks: Sequence[T],
    work: Work[T],
    out: Path,
    jobs: int,
    progress: Progress = lambda done, missing: None,
) -> list[Record]:
    """Measure what has no record yet; return the records of all, in the plan's order.

    Parameters
    ----------
    tasks : sequence of Task
        Clips, say.
    work : callable
        From one of them to its record.
    out : Path
        File of results, made where there is none; whatever else it holds stays in it.
    jobs : int
        Processes.
    progress : callable, optional
        Called with the number measured so far, and of those that were missing.
    """
    with Journal(out) as journal:
        missing = [task for task in tasks if task.key not in journal.records]
        progress(0, len(missing))
        for done, record in enumerate(work_all(missing, work, jobs), 1):
            journal.add(record)
            progress(done, len(missing))
        return journal.of(task.key for task in tasks)
