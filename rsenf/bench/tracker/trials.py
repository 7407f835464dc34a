"""Which costs are measured, each in a process of its own, and their records."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from rsenf import __version__
from rsenf.batch.journal import Record, read_records
from rsenf.bench.pipeline.films import SIZES
from rsenf.bench.session import measure_missing
from rsenf.bench.tracker.beside import Beside
from rsenf.bench.tracker.hour import Hour
from rsenf.bench.tracker.planes import Planes
from rsenf.track import METHODS, TrackSettings

VERSION = 1
RESULTS, FILMS = "tracker.jsonl", "films"
ROWS, RATE_HZ = 1080, 29.97
OTHER_ROWS, OTHER_RATES_HZ = (480, 720, 2160), (23.976, 59.94, 119.88)
HOURS = (0.25, 0.5, 1.0)
FRAMES = 300

Trial = Hour | Beside | Planes


def trials(parts: int, part_s: float, *, quick: bool) -> list[Trial]:
    """Return all trials: the usual method on everything, the others on what is usual."""
    usual = TrackSettings().method
    hour = partial(Hour, parts=parts, part_s=part_s)
    if quick:
        return [
            hour(usual, SIZES["480p"][1], RATE_HZ), Planes("480p", parts, 4),
            Beside(30, parts, part_s),
        ]  # fmt: skip
    blocks = {size: max((200 << 20) // (w * h * 8), 4) for size, (w, h) in SIZES.items()}
    return [
        *(hour(usual, rows, RATE_HZ) for rows in sorted((ROWS, *OTHER_ROWS))),
        *(hour(usual, ROWS, rate_hz) for rate_hz in OTHER_RATES_HZ),
        *(hour(method, ROWS, RATE_HZ) for method in METHODS if method != usual),
        *(hour("stft", ROWS, RATE_HZ, settings={"harmonic": k}) for k in (2, 3)),
        hour("stft", ROWS, RATE_HZ, settings={"nominal_hz": 50.0, "line_m": -3}),
        hour("paper", ROWS, RATE_HZ, settings={"nominal_hz": 50.0}),
        *(Hour(usual, SIZES["480p"][1], RATE_HZ, 1, 3600 * hours) for hours in HOURS),
        Beside(FRAMES, parts, 2 * part_s),
        *(Planes(size, parts, blocks[size]) for size in SIZES),
    ]


def measure_trials(
    all_trials: Sequence[Trial], folder: Path, seed: int, progress: Callable[[str], None]
) -> list[Record]:
    """Measure what has no record yet, one after the other.

    Parameters
    ----------
    all_trials : sequence of Trial
    folder : Path
        Where films and results are kept.
    seed : int
    progress : callable
        Told what comes next.
    """
    out, work = folder / RESULTS, partial(measured, seed=seed, films=folder / FILMS)
    for trial in all_trials:
        if trial.key not in read_records(out):
            progress(trial.key)
            measure_missing([trial], work, out, 1)
    records = read_records(out)
    return [records[trial.key] for trial in all_trials]


def measured(trial: Trial, seed: int, films: Path) -> Record:
    """Measure one of them."""
    load = os.getloadavg()[0]
    found = trial.measure(seed, films) if isinstance(trial, Beside) else trial.measure(seed)
    return {
        "version": VERSION,
        "key": trial.key,
        "kind": type(trial).__name__.lower(),
        "load": load,
        "rsenf": __version__,
        **found,
    }
