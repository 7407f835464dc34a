"""Contestants take turns over films, each time in a process of its own."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rsenf import __version__
from rsenf.batch.journal import Record, read_records
from rsenf.bench.pipeline.contestants import LIVE, contestants, time_it
from rsenf.bench.pipeline.films import Film, made
from rsenf.bench.pipeline.others import watch_others
from rsenf.bench.session import measure_missing

VERSION = 2
RESULTS, FILMS = "pipeline.jsonl", "films"
LIVE_FRAMES = 900


@dataclass(frozen=True)
class Turn:
    """One turn of one of them."""

    contestant: str
    film: Film
    number: int

    @property
    def key(self) -> str:
        """Name that tells it from any other."""
        return f"{self.film.name} {self.contestant} {self.number} v{VERSION}"


def turns(films: Sequence[Film], rounds: int) -> list[Turn]:
    """Return all turns of some films: in each round everybody has one, so that load hits all."""
    out = []
    for film in films:
        again = [Turn(name, film, n) for n in range(rounds) for name in contestants()]
        once = Film(film.size, film.codec, LIVE_FRAMES, film.filmed, film.seed)
        out += [*again, Turn(LIVE, once, 0)]
    return out


def measure_turns(
    all_turns: Sequence[Turn], folder: Path, progress: Callable[[str, int, int], None]
) -> list[Record]:
    """Time what has no record yet; films are made as they are needed.

    Parameters
    ----------
    all_turns : sequence of Turn
    folder : Path
        Where films and results are kept.
    progress : callable
        Told what comes next, and how many are done of how many.
    """
    out, work = folder / RESULTS, partial(taken, films=folder / FILMS)
    for done, turn in enumerate(all_turns):
        if turn.key not in read_records(out):
            progress(turn.key, done, len(all_turns))
            made(turn.film, folder / FILMS)
            measure_missing([turn], work, out, 1)
    records = read_records(out)
    return [records[turn.key] for turn in all_turns]


def taken(turn: Turn, films: Path) -> Record:
    """Take a turn."""
    film = turn.film
    path, others = made(film, films), watch_others()
    timed = time_it(turn.contestant, film, path)
    return {
        "version": VERSION,
        "key": turn.key,
        "contestant": turn.contestant,
        "size": film.size,
        "codec": film.codec,
        "bitrate_bps": film.bitrate_bps,
        "number": turn.number,
        "others_ratio": others(),
        "cores": os.cpu_count(),
        "rsenf": __version__,
        **timed,
    }
