"""Clips are worked through side by side; what can't be done ends the run."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import Any, Protocol, TypeVar

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
