"""A benchmark from its plan to its records: measures what the file of results lacks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rsenf.batch.journal import Journal, Record
from rsenf.batch.pool import Work
from rsenf.bench.workers import T, work_all

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
