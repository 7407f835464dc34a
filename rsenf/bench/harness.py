"""The harness of every benchmark: from its tasks to their records, and the machine meanwhile.

A task is what a function is given in a worker process, and the key of its record. Records are
appended to a journal (:mod:`rsenf.batch.journal`); a stopped run resumes with the tasks that have
none. Where time and memory are measured, the memory of a process and the processor time of other
programs are too.
:mod:`rsenf.bench` declares the benchmarks, each with a function from :class:`BenchRun` to
:class:`Made`.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import psutil

from rsenf.batch.journal import Journal, Record, read_records
from rsenf.batch.pool import Trouble, worked
from rsenf.errors import NodeFailed, UsageError

PEAK, HELD, SHARE = "VmHWM", "VmRSS", "Pss"
# Above this share, frame rates depend on how many processes compete, not on their speed.
BUSY_RATIO = 0.1
_NOT_COUNTED_TWICE = 8  # times; a guest's, after them, are included in the user's


A = TypeVar("A")
# What is measured in one go, such as a clip: what the function is given, by the key of its record.
Tasks = Mapping[str, tuple[Any, ...]]
Work = Callable[..., Record]
Progress = Callable[[int, int], None]


def measure_missing(
    tasks: Tasks,
    work: Work,
    out: Path,
    jobs: int,
    progress: Progress = lambda done, missing: None,
) -> list[Record]:
    """Measure the tasks without a record; return the records of all, in the order of the tasks.

    Parameters
    ----------
    work : callable
        From what it is given to a record; worker processes import it by its name.
    out : Path
        The journal, created if necessary; its other records are kept.
    progress : callable, optional
        Called with the numbers of tasks measured so far and of those without a record; an
        exception of it ends all processes at once.

    Raises
    ------
    NodeFailed
        When a process dies, or a task raises an exception.
    """
    with Journal(out) as journal:
        missing = [task for task in tasks.items() if task[0] not in journal.records]
        progress(0, len(missing))
        for number, done in enumerate(worked(missing, partial(_recorded, work), jobs), 1):
            if isinstance(done.answer, Trouble):
                if not done.answer.died:
                    print(done.answer.trace, file=sys.stderr)
                hint = "not enough memory? try --jobs 1" if done.answer.died else ""
                raise NodeFailed(f"'{done.task[0]}' can't be done: {done.answer.text}", hint)
            journal.add(done.answer)
            progress(number, len(missing))
        return journal.of(tasks)


def _recorded(work: Work, task: tuple[str, tuple[Any, ...]]) -> Record:
    key, given = task
    return {"key": key} | work(*given)


def known_names(given: Iterable[str], known: Collection[str], what: str) -> None:
    """Raise UsageError for the first name that isn't known.

    Parameters
    ----------
    what : str
        What they are names of, such as ``size``.
    """
    if unknown := set(given) - set(known):
        raise UsageError(f"no {what} {min(unknown)!r}", f"one of {', '.join(known)}")


class Made(NamedTuple):
    """What a benchmark makes of its records: plain values, and functions that write them."""

    document: dict[str, Any]
    text: Callable[..., str]  # of the document; with `on_page` in Markdown
    draw: Callable[[Path, Any], None] | None = None  # the document, into a PNG file
    fitted: Callable[[], Any] | None = None  # plain values of the file for --fit


@dataclass(frozen=True)
class BenchRun:
    """One run of a benchmark: its options, where results are, and how progress is told."""

    options: argparse.Namespace
    folder: Path  # of results, and of films
    settings: Callable[..., Any]  # from more defaults to the benchmark's plan by the options
    say: Callable[[str], None]  # a line of progress
    note: Callable[[str], None]  # a line on what is left out
    # From what is counted and how many there are to a context with a progress bar.
    counting: Callable[[str, int], AbstractContextManager[Progress]]

    def kept(self, file: str) -> list[Record] | None:
        """Return the records of a file of results with ``--table-only``, else None."""
        return list(read_records(self.folder / file).values()) if self.options.table_only else None

    def records(self, tasks: Tasks, work: Work, file: str, what: str) -> list[Record]:
        """Measure what is missing in parallel, with a progress bar.

        Parameters
        ----------
        what : str
            What is measured, for the progress bar.
        """
        if (kept := self.kept(file)) is not None:
            return kept
        with self.counting(what, len(tasks)) as progress:
            jobs = max(int(self.options.jobs), 1)
            return measure_missing(tasks, work, self.folder / file, jobs, progress)

    def in_turn(
        self,
        tasks: Tasks,
        work: Work,
        file: str,
        prepare: Callable[..., object] = lambda *given: None,
    ) -> list[Record]:
        """Measure what is missing one by one, each in a new process: for times and memory.

        Parameters
        ----------
        prepare : callable, optional
            Called in this process with what the function is given, before it is measured.
        """
        if (kept := self.kept(file)) is not None:
            return kept
        out = self.folder / file
        known = read_records(out)
        for number, (key, given) in enumerate(tasks.items(), 1):
            if key not in known:
                self.say(f"{number}/{len(tasks)}: {key}")
                prepare(*given)
                measure_missing({key: given}, work, out, 1)
        known = read_records(out)
        return [known[key] for key in tasks]


def memory_mb(which: str = HELD, pid: int | str = "self") -> float | None:
    """Return the memory of a process, MB; None where the system doesn't report it.

    Parameters
    ----------
    which : str
        Resident memory now, :data:`HELD`, or the most so far, :data:`PEAK`; or the proportional set
        size, :data:`SHARE`, in which pages of several processes are divided among them.
    """
    with suppress(OSError):
        table = "smaps_rollup" if which == SHARE else "status"
        for line in Path(f"/proc/{pid}/{table}").read_text(encoding="ascii").splitlines():
            if line.startswith(f"{which}:"):
                return int(line.split()[1]) / 1024
    return None


def watch_memory() -> Callable[[], float | None]:
    """Start to watch this process; return what tells its most memory since, beyond that now, MB."""
    # The peak of getrusage() can't be reset, and a new process inherits its parent's.
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    held_mb = memory_mb(HELD)

    def most_mb() -> float | None:
        peak_mb = memory_mb(PEAK)
        return peak_mb - held_mb if peak_mb and held_mb else None

    return most_mb


def timed(work: Callable[..., A], *given: Any) -> tuple[A, float]:
    """Return a result and the processor time (s) of its computation."""
    began_s = time.process_time()
    return work(*given), time.process_time() - began_s


def watch_others() -> Callable[[], float]:
    """Return what tells the share of all cores that other programs have taken since."""
    begun_s, before_s = time.monotonic(), _others_s()

    def share() -> float:
        whole_s = (time.monotonic() - begun_s) * (os.cpu_count() or 1)
        return max(_others_s() - before_s, 0.0) / whole_s

    return share


def _others_s() -> float:
    """Return the processor time of all processes but this one and its children, s."""
    spent = psutil.cpu_times()
    idle_s = spent.idle + getattr(spent, "iowait", 0.0)  # which not every system tells
    return float(sum(spent[:_NOT_COUNTED_TWICE]) - idle_s - sum(os.times()[:4]))


def most_of_others(records: Sequence[Record]) -> float | None:
    """Return the largest share of other programs in some records."""
    return max((r["others_ratio"] for r in records if r["others_ratio"] is not None), default=None)


def others_said(document: dict[str, Any]) -> str:
    """Return a note for a table if other programs took much of the machine, else nothing."""
    ratio = document["others_ratio"]
    if ratio is None or ratio <= BUSY_RATIO:
        return ""
    taken = f"; other programs took up to {100 * ratio:.0f} % of the machine"
    return f"{taken}: go by processor time alone"


def loads_of(records: Sequence[Record]) -> list[float]:
    """Return the least and the largest load of the machine in some records."""
    return [min(r["load"] for r in records), max(r["load"] for r in records)]


def load_said(document: dict[str, Any]) -> str:
    """Return a note on the loads of a document."""
    low, high = document["loads"]
    return f"load of the machine: {low:.1f} to {high:.1f}"
