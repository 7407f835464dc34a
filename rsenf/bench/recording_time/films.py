"""Films on disk, a folder for each: the rows of each coding as a recording, and the truth.

A film shows a wall in a lamp's light; moving ones are hand-held, and an object passes.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.film import film
from rsenf.bench.grids import MARGIN_S
from rsenf.bench.harness import Progress, work_all
from rsenf.bench.measure import versions
from rsenf.bench.recording_time.plan import FRAME_RATE, MOVING, NOMINAL_HZ, Film
from rsenf.bench.recording_time.references import lit_day
from rsenf.bench.scenes import EXPOSURE_S, IDLE_RATIO, Setting, spread, wall
from rsenf.errors import InputError, RecordingError
from rsenf.messages import RowBlock
from rsenf.model import CaptureModel, GridPath, Shake
from rsenf.record.reader import open_recording
from rsenf.record.writer import Recorder

# Clock errors of cameras, Student's t: most within 30 ppm, few up to 70 ppm.
CLOCK_PPM, CLOCK_FREEDOM = 25.0, 4

WIDTH_RATIO, HEIGHT_RATIO, TOP_RATIO = (0.1, 0.3), (0.3, 0.7), (0.0, 0.5)
PERIOD_S, LEVEL_RATIO = (4.0, 20.0), (0.5, 1.3)
SHAKE_PX, SHAKE_S = (0.1, 0.6), (0.1, 0.5)


def setting_of(film: Film) -> Setting:
    """Return the capture of a film, drawn from its camera and its seed."""
    camera, rng = film.camera_generator(), film.generator("scene")
    idle_ratio = float(camera.uniform(*IDLE_RATIO))
    model = wall(film.key, film.lamp, film.size, FRAME_RATE, idle_ratio, rng)
    exposure_s = spread(rng, EXPOSURE_S)
    seed = int(rng.integers(2**31))
    clock_ppm = CLOCK_PPM * float(camera.standard_t(CLOCK_FREEDOM))
    model = model.with_effect("exposure", exposure_s=exposure_s)
    model = model.with_effect("clock_skew", clock_ppm=clock_ppm)
    return Setting(_moving(model, rng) if film.kind == MOVING else model, seed, exposure_s)


def _moving(model: CaptureModel, rng: np.random.Generator) -> CaptureModel:
    """Return a capture with a passing object and camera shake."""
    shake = Shake(shake_px=spread(rng, SHAKE_PX), time_constant_s=spread(rng, SHAKE_S))
    held = replace(model, scene=replace(model.scene, shake=shake))
    return held.with_effect(
        "moving_object",
        width_ratio=float(rng.uniform(*WIDTH_RATIO)),
        height_ratio=float(rng.uniform(*HEIGHT_RATIO)),
        top_ratio=float(rng.uniform(*TOP_RATIO)),
        period_s=spread(rng, PERIOD_S),
        level_ratio=float(rng.uniform(*LEVEL_RATIO)),
    )


VERSION = 1
_TRUTH = "truth.json"
_TOPIC = "rows"


def has_film(folder: Path, wanted: Film) -> bool:
    """Whether a folder has a film."""
    return (folder / wanted.key / _TRUTH).is_file()


def make_film(wanted: Film, folder: Path, grids: Path | None) -> dict[str, Any]:
    """Render, encode and decode a film once, and write its rows; return the truth.

    Parameters
    ----------
    wanted : Film
    folder : Path
        Of all films, with a folder for each.
    grids : Path or None
        Folder of measured grids.

    Raises
    ------
    RecordingError
        When it can't be written.
    """
    begin_s, setting, day = time.perf_counter(), setting_of(wanted), lit_day(grids)
    latest_s = wanted.reference_s - wanted.duration_s - MARGIN_S
    start_s = float(wanted.generator("start").uniform(0, latest_s))
    grid = GridPath(day.freq_hz, day.step_s, start_s, NOMINAL_HZ)
    filmed = film(setting, grid, wanted.duration_s, wanted.codings)
    record = {
        "version": VERSION,
        "film": dataclasses.asdict(wanted),
        "grid": day.grid,
        "flicker_level": setting.flicker_levels(NOMINAL_HZ)[0],
        "truth": filmed.truth,
        "cpu_s": {step: round(s, 2) for step, s in filmed.cpu_s.items()},
        "wall_s": round(time.perf_counter() - begin_s, 2),
        "versions": versions(),
    }
    keep_film(wanted, folder, record, filmed.blocks)
    return record


def keep_film(
    wanted: Film, folder: Path, record: dict[str, Any], rows: Mapping[str, Sequence[RowBlock]]
) -> None:
    """Write rows and truth of a film into a folder, which appears when it is complete.

    Raises
    ------
    RecordingError
        When it can't be written.
    """
    part = folder / f".{wanted.key}.part"
    try:
        shutil.rmtree(part, ignore_errors=True)  # of a killed run
        part.mkdir(parents=True)
        for coding, blocks in rows.items():
            _write(part / f"{coding}.mcap", blocks)
        (part / _TRUTH).write_text(json.dumps(record, allow_nan=False), encoding="utf-8")
        os.replace(part, folder / wanted.key)
    except OSError as exc:
        raise RecordingError(f"can't write {part}: {exc.strerror}", "choose another --out") from exc
    finally:
        shutil.rmtree(part, ignore_errors=True)


def read_truth(folder: Path, wanted: Film) -> dict[str, Any]:
    """Return the truth of a film.

    Raises
    ------
    InputError
        When it can't be read, or is of another version of this format.
    """
    path = folder / wanted.key / _TRUTH
    try:
        record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as exc:
        raise InputError(f"{path}: not the truth of a film", "delete its folder") from exc
    if record.get("version") != VERSION:
        raise InputError(f"{path}: of another version", "delete its folder, or take another --out")
    return record


def read_rows(folder: Path, wanted: Film, coding: str) -> list[RowBlock]:
    """Return the rows of one coding of a film."""
    recording = open_recording(folder / wanted.key / f"{coding}.mcap")
    return [message for _, message, _ in recording.messages([_TOPIC])]


def _write(path: Path, blocks: Sequence[RowBlock]) -> None:
    with Recorder(path, run_info={}, clock_ns=time.time_ns, fsync=False) as recorder:
        for block in blocks:
            recorder.write(_TOPIC, block)


def make_missing(
    films: Sequence[Film],
    folder: Path,
    grids: Path | None,
    jobs: int,
    progress: Progress = lambda done, missing: None,
) -> None:
    """Create the films that a folder lacks.

    Parameters
    ----------
    films : sequence of Film
    folder : Path
        Created if necessary; its other content is kept.
    grids : Path or None
        Folder of measured grids.
    jobs : int
        Processes.
    progress : callable, optional
        Called with the number of films created so far, and of those that were missing.
    """
    missing = [film for film in films if not has_film(folder, film)]
    progress(0, len(missing))
    work = partial(make_film, folder=folder, grids=grids)
    for done, _ in enumerate(work_all(missing, work, jobs), 1):
        progress(done, len(missing))
