"""A benchmark from its plan to its records: measures what the file of results lacks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rsenf.bench.plan import Clip
from rsenf.bench.results import Record, Results
from rsenf.bench.workers import measure_all


def measure_missing(
    clips: Sequence[Clip],
    out: Path,
    grids: Path | None,
    jobs: int,
    progress: Callable[[int, int], None] = lambda done, missing: None,
) -> list[Record]:
    """Measure the clips that have no record yet; return the records of all, in the plan's order.

    Parameters
    ----------
    clips : sequence of Clip
    out : Path
        File of results, made where there is none; whatever else it holds stays in it.
    grids : Path or None
        Folder of measured grids.
    jobs : int
        Processes.
    progress : callable, optional
        Called with the number of clips measured so far, and of those that were missing.
    """
    with Results(out) as results:
        missing = [clip for clip in clips if clip.key not in results.records]
        progress(0, len(missing))
        for done, record in enumerate(measure_all(missing, grids, jobs), 1):
            results.add(record)
            progress(done, len(missing))
        return results.of(clip.key for clip in clips)
