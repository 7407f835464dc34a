"""What a film shows, and the references that a piece of it is searched in.

A film shows a wall in a lamp's light, which follows a day of the grid; moving ones are hand-held,
and an object passes.
"""

from __future__ import annotations

import functools
import math
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

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
from rsenf.model import CaptureModel, GridPath, Shake, synthetic_grid
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
    part, since_ns = slice(first, first + samples), nanoseconds(first * reference.step_s)
    return replace(
        reference,
        t0_ns=reference.t0_ns + since_ns if reference.t0_ns else 0,
        freq_hz=reference.freq_hz[part],
        readings=reference.readings[part],
    )


def _synthetic(seed: int) -> Reference:
    freq_hz = synthetic_grid(seed, DAY_S, nominal_hz=NOMINAL_HZ).freq_hz[: int(DAY_S)]
    return Reference("synthetic", NOMINAL_HZ, 0, 1.0, freq_hz, np.ones(freq_hz.size, np.uint32))


NOISE_HZ = 0.3e-3
STEP_HZ = 1e-4  # resolution of published values
GAP_S = 600.0  # margin of the gap on either side of the piece
# What is searched: the film's day, the same with a gap at the piece's time, a day of another year.
PRESENT = "present"
SAME_DAY, OTHER_DAY = "same_day", "other_day"


def references_of(
    film: Film, begin_s: float, end_s: float, grids: Path | None
) -> Iterator[tuple[str, Reference]]:
    """Yield the names and references of the trials of a piece of a film.

    Each reference has independent noise and is rounded. All codings have the same ones.

    Parameters
    ----------
    film : Film
    begin_s, end_s : float
        Of the piece, from the start of the day.
    grids : Path or None
        Folder of measured grids.
    """
    day, other = (
        stretch(of, 0, round(film.reference_s / of.step_s))
        for of in (lit_day(grids), other_day(grids))
    )
    lacking = _without(day, begin_s - GAP_S, end_s + GAP_S)
    for trial, reference in ((PRESENT, day), (SAME_DAY, lacking), (OTHER_DAY, other)):
        seed = zlib.crc32(f"{film.kind} {trial} {begin_s:.3f} {end_s:.3f}".encode())
        noise = np.random.default_rng([film.seed, seed]).standard_normal(reference.freq_hz.size)
        freq_hz = np.round((reference.freq_hz + NOISE_HZ * noise) / STEP_HZ) * STEP_HZ
        yield trial, replace(reference, freq_hz=freq_hz)


def _without(reference: Reference, begin_s: float, end_s: float) -> Reference:
    """Return a reference with a gap, of all samples that overlap it."""
    first, stop = math.floor(begin_s / reference.step_s), math.ceil(end_s / reference.step_s)
    kept = np.arange(reference.freq_hz.size)
    missing = (kept >= first) & (kept < stop)
    return replace(
        reference,
        freq_hz=np.where(missing, np.nan, reference.freq_hz),
        readings=np.where(missing, 0, reference.readings).astype(np.uint32),
    )


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


def grid_path(film: Film, grids: Path | None) -> GridPath:
    """Return the grid's frequency from the film's start on, which is drawn."""
    day = lit_day(grids)
    latest_s = film.reference_s - film.duration_s - MARGIN_S
    start_s = float(film.generator("start").uniform(0, latest_s))
    return GridPath(day.freq_hz, day.step_s, start_s, NOMINAL_HZ)
