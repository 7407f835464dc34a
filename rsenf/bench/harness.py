"""The harness of every benchmark: from its tasks to their records.

A task has a key, and a function measures it in a worker process. Records are appended to a journal
(:mod:`rsenf.batch.journal`); a stopped run resumes with the tasks that have no record.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from rsenf.batch.journal import Journal, Record, read_records
from rsenf.batch.pool import Trouble, Work, worked
from rsenf.errors import NodeFailed


class Task(Protocol):
    """What is measured in one go, such as a clip."""

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        ...


T = TypeVar("T", bound=Task)
Progress = Callable[[int, int], None]


def work_all(tasks: Sequence[T], work: Work[T], jobs: int) -> Iterator[dict[str, Any]]:
    """Measure tasks in parallel processes; yields each record when it is done.

    Closing the iterator, or an exception in its user, ends the processes at once.

    Parameters
    ----------
    tasks : sequence of Task
    work : callable
        From a task to its record; worker processes import it by its name.
    jobs : int
        Number of processes.

    Raises
    ------
    NodeFailed
        When a process dies, or a task raises an exception.
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


def measure_missing(
    tasks: Sequence[T],
    work: Work[T],
    out: Path,
    jobs: int,
    progress: Progress = lambda done, missing: None,
) -> list[Record]:
    """Measure the tasks without a record; return the records of all, in the order of the tasks.

    Parameters
    ----------
    tasks : sequence of Task
    work : callable
        From a task to its record.
    out : Path
        The journal, created if necessary; its other records are kept.
    jobs : int
        Number of processes.
    progress : callable, optional
        Called with the number of tasks measured so far, and of those that had no record.
    """
    with Journal(out) as journal:
        missing = [task for task in tasks if task.key not in journal.records]
        progress(0, len(missing))
        for done, record in enumerate(work_all(missing, work, jobs), 1):
            journal.add(record)
            progress(done, len(missing))
        return journal.of(task.key for task in tasks)


def measure_in_turn(
    tasks: Sequence[T], work: Work[T], out: Path, prepare: Callable[[int, T], object]
) -> list[Record]:
    """Measure the tasks without a record one by one, each in a new process: for times and memory.

    Parameters
    ----------
    tasks : sequence of Task
    work : callable
        From a task to its record.
    out : Path
        The journal, created if necessary.
    prepare : callable
        Called in this process with the index of a task and the task, before it is measured.
    """
    records = read_records(out)
    for done, task in enumerate(tasks):
        if task.key not in records:
            prepare(done, task)
            measure_missing([task], work, out, 1)
    records = read_records(out)
    return [records[task.key] for task in tasks]
