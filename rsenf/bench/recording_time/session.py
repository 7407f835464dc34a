"""From a plan to its records: makes the films that are missing, then tries what wasn't yet."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rsenf.bench.recording_time.cuts import LENGTHS_S, Cuts
from rsenf.bench.recording_time.films import has_film, make_film
from rsenf.bench.recording_time.plan import Film
from rsenf.bench.recording_time.trials import known_methods
from rsenf.bench.session import Progress
from rsenf.bench.workers import work_all


def make_missing(
    films: Sequence[Film],
    folder: Path,
    grids: Path | None,
    jobs: int,
    progress: Progress = lambda done, missing: None,
) -> None:
    """Make the films that a folder lacks; one that is there isn't made again.

    Parameters
    ----------
    films : sequence of Film
    folder : Path
        Made where there is none; whatever else it holds stays in it.
    grids : Path or None
        Folder of measured grids.
    jobs : int
        Processes.
    progress : callable, optional
        Called with the number made so far, and of those that were missing.
    """
    missing = [film for film in films if not has_film(folder, film)]
    progress(0, len(missing))
    work = partial(make_film, folder=folder, grids=grids)
    for done, _ in enumerate(work_all(missing, work, jobs), 1):
        progress(done, len(missing))


def cuts_of(films: Sequence[Film], noise_hz: float) -> list[Cuts]:
    """Return what is to be tried, film by film; lengths that a film doesn't have aren't."""
    return [
        Cuts(film, coding, length_s, known_methods(), noise_hz)
        for film in films
        for coding in film.codings
        for length_s in LENGTHS_S
        if length_s <= film.duration_s
    ]
