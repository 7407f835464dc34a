"""Films on disk, a folder for each: the rows of each coding as a recording, and the truth.

A film shows a wall in a lamp's light, which follows a day of the grid; moving ones are hand-held,
and an object passes. With them: the references that a piece of a film is searched in.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import os
import shutil
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.harness import Progress, work_all
from rsenf.bench.measure import film, versions
from rsenf.bench.recording_time import DAY_S, FRAME_RATE, MOVING, NOMINAL_HZ, Film
from rsenf.bench.scenes import (
    CE_2024,
    EXPOSURE_S,
    IDLE_RATIO,
    MARGIN_S,
    MEASURED,
    Setting,
    spread,
    wall,
)
from rsenf.errors import InputError, RecordingError
from rsenf.messages import RowBlock
from rsenf.model import CaptureModel, GridPath, Shake, synthetic_grid
from rsenf.record.reader import open_recording
from rsenf.record.writer import Recorder
from rsenf.reference import Reference, read_reference
from rsenf.timebase import NS_PER_S, nanoseconds

# 2024-08-18 UTC; data before it is for calibration.
OTHER_FROM_NS = 1_723_939_200 * NS_PER_S
_SEEDS = (50, 51)  # of synthetic days


@functools.cache
def lit_day(grids: Path | None) -> Reference:
    """Return the day that the light of the films follows.

    Parameters
    ----------
    grids : Path or None
        Folder of measured grids; without it or its file, the day is synthetic.
    """
    path = grids / MEASURED[NOMINAL_HZ] if grids else None
    return read_reference(path) if path and path.is_file() else _synthetic(_SEEDS[0])


@functools.cache
def other_day(grids: Path | None) -> Reference:
    """Return 24 h of another year, those with the fewest gaps; none of the data for calibration."""
    path = grids / CE_2024 if grids else None
    if not path or not path.is_file():
        return _synthetic(_SEEDS[1])
    whole = read_reference(path)
    first = max(-(-(OTHER_FROM_NS - whole.t0_ns) // nanoseconds(whole.step_s)), 0)
    length = round(DAY_S / whole.step_s)
    valid = np.concatenate(([0], np.cumsum(np.isfinite(whole.freq_hz[first:]))))
    return stretch(whole, first + int(np.argmax(valid[length:] - valid[:-length])), length)


def stretch(reference: Reference, first: int, samples: int) -> Reference:
    """Return a part of a reference, from sample ``first`` on."""
    part = slice(first, first + samples)
    return Reference(
        grid=reference.grid,
        nominal_hz=reference.nominal_hz,
        t0_ns=reference.t0_ns + nanoseconds(first * reference.step_s) if reference.t0_ns else 0,
        step_s=reference.step_s,
        freq_hz=reference.freq_hz[part],
        readings=reference.readings[part],
    )


def _synthetic(seed: int) -> Reference:
    freq_hz = synthetic_grid(seed, DAY_S, nominal_hz=NOMINAL_HZ).freq_hz[: int(DAY_S)]
    return Reference("synthetic", NOMINAL_HZ, 0, 1.0, freq_hz, np.ones(freq_hz.size, np.uint32))


NOISE_HZ = 0.3e-3
STEP_HZ = 1e-4  # resolution of published values
GAP_S = 600.0  # margin of the gap on either side of the piece
PRESENT = "present"
ABSENT = ("same_day", "other_day")


@dataclass(frozen=True, eq=False)
class Searched:
    """A reference of a trial.

    Parameters
    ----------
    trial : str
        :data:`PRESENT`, or one of :data:`ABSENT`: the film's day with a gap at its time, and a day
        of another year.
    reference : Reference
    """

    trial: str
    reference: Reference


def references_of(
    film: Film, begin_s: float, end_s: float, noise_hz: float, grids: Path | None
) -> Iterator[Searched]:
    """Yield the references for a piece of a film.

    Each has independent noise and is rounded. All codings of a piece have the same references.

    Parameters
    ----------
    film : Film
    begin_s, end_s : float
        Of the piece, from the start of the day.
    noise_hz : float
    grids : Path or None
        Folder of measured grids.
    """
    day, other = (
        stretch(of, 0, round(film.reference_s / of.step_s))
        for of in (lit_day(grids), other_day(grids))
    )
    for trial, reference in (
        (PRESENT, day),
        (ABSENT[0], _without(day, begin_s - GAP_S, end_s + GAP_S)),
        (ABSENT[1], other),
    ):
        seed = zlib.crc32(f"{film.kind} {trial} {begin_s:.3f} {end_s:.3f}".encode())
        yield Searched(
            trial, _measured(reference, noise_hz, np.random.default_rng([film.seed, seed]))
        )


def _without(reference: Reference, begin_s: float, end_s: float) -> Reference:
    """Return a reference with a gap, of all samples that overlap it."""
    first, stop = math.floor(begin_s / reference.step_s), math.ceil(end_s / reference.step_s)
    kept = np.arange(reference.freq_hz.size)
    missing = (kept >= first) & (kept < stop)
    return dataclasses.replace(
        reference,
        freq_hz=np.where(missing, np.nan, reference.freq_hz),
        readings=np.where(missing, 0, reference.readings).astype(np.uint32),
    )


def _measured(reference: Reference, noise_hz: float, rng: np.random.Generator) -> Reference:
    noisy = reference.freq_hz + noise_hz * rng.standard_normal(reference.freq_hz.size)
    return dataclasses.replace(reference, freq_hz=np.round(noisy / STEP_HZ) * STEP_HZ)


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
