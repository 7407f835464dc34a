"""Cost of an hour of video after its frames are decoded.

Here: which costs are measured, each in a new process, and their tables. Row means are timed on
planes that the cache doesn't hold, beside copies of the same planes. ``beside`` has the others: an
ENF method on an hour of rows; all stages after the row means, beside decoding 1080p.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rsenf import __version__
from rsenf.batch.journal import Record
from rsenf.bench.harness import BenchRun, Made, load_said, loads_of
from rsenf.bench.measure import frame_of
from rsenf.bench.pipeline import SIZES
from rsenf.bench.statistics import Row
from rsenf.bench.tables import Column, table_of, titled
from rsenf.bench.tracker.beside import AFTER, Beside, Hour
from rsenf.model.noise import generator
from rsenf.rows.settings import RowsSettings
from rsenf.rows.stage import Rows
from rsenf.rows.steady import tile_sums
from rsenf.track import METHODS, TrackSettings

Luma = NDArray[np.uint8]

BLOCK_FRAMES = RowsSettings().block_frames
HELD_BYTES = 64 << 20  # of all planes: more than the cache holds
LEVELS, NOISE, LIT = (70, 130), 3, 210
ALIGNED_PX = 64  # alignment of a decoder's lines
VERSION = 1
RESULTS, FILMS = "tracker.jsonl", "films"
ROWS, RATE_HZ = 1080, 29.97
OTHER_ROWS, OTHER_RATES_HZ = (480, 720, 2160), (23.976, 59.94, 119.88)
HOURS = (0.25, 0.5, 1.0)
FRAMES = 300
_SAMPLED = ("read", "means", "still", "moving")
_NOTE = """\
s an hour: seconds of processor time for an hour of rows, once flicker has been found; MB: the most
memory beyond what the program held before. ÷ decode: over PyAV decoding the film on one thread, in
the same round; after: all stages after the row means together, the usual settings, a result of the
match every minute. Planes, microseconds each: copied to one that the cache may hold; read once, for
the brightest pixel; one mean a row; two strips with the steady-pixel mask, everything up to the
block of rows. Lines are padded as decoders pad them. Medians of rounds of processor time, and of
their own ratios."""


@dataclass(frozen=True)
class Planes:
    """Row means of planes of one size."""

    size: str  # of :data:`rsenf.bench.pipeline.SIZES`
    rounds: int
    blocks: int  # of frames in each round

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        return f"planes {self.size} {self.rounds} x {self.blocks} blocks, read as well"

    def measure(self, seed: int) -> dict[str, Any]:
        """Time copies, reads and row means in turn; return microseconds a plane by round."""
        width_px, height_px = SIZES[self.size]
        still, moving = (_planes(height_px, width_px, seed, box=box) for box in (False, True))
        to = np.empty_like(still[0])
        works: dict[str, tuple[list[Any], Callable[[Any], Any]]] = {
            "copy": (still, lambda luma: np.copyto(to, luma)),
            "read": (still, lambda luma: cv2.norm(luma, cv2.NORM_INF)),
            "means": (still, _row_means(width_px)),
            "still": ([frame_of(n, luma) for n, luma in enumerate(still)], Rows().update),
            "moving": ([frame_of(n, luma) for n, luma in enumerate(moving)], Rows().update),
        }
        rounds = [  # the first one is a warm-up
            {name: self._timed_us(of, work) for name, (of, work) in works.items()}
            for _ in range(1 + self.rounds)
        ]
        return {"size": self.size, "us": rounds[1:]}

    def _timed_us(self, of: list[Any], work: Callable[[Any], Any]) -> float:
        count = self.blocks * BLOCK_FRAMES
        begun_s = time.process_time()
        for number in range(count):
            work(of[number % len(of)])
        return (time.process_time() - begun_s) / count * 1e6


def _row_means(width_px: int) -> Callable[[Luma], None]:
    """Return a function that takes planes, and computes row means block by block."""
    sums: list[Any] = []

    def take(luma: Luma) -> None:
        sums.append(tile_sums(luma, "rows", 1))
        if len(sums) == BLOCK_FRAMES:
            np.array(sums, np.float32) / width_px
            sums.clear()

    return take


def _planes(height_px: int, width_px: int, seed: int, *, box: bool) -> list[Luma]:
    """Return planes of a textured wall as a decoder lays them out, if wanted with a moving box."""
    rng = generator(seed, "planes")
    padded_px = -(-width_px // ALIGNED_PX) * ALIGNED_PX
    wall = rng.integers(*LEVELS, (height_px, padded_px), np.uint8)
    out = []
    for number in range(max(HELD_BYTES // (wall.size * BLOCK_FRAMES), 1) * BLOCK_FRAMES):
        plane = wall + rng.integers(0, NOISE, padded_px, np.uint8)
        if box:
            left = number * width_px // 32 % (width_px * 3 // 4)
            plane[height_px // 4 : height_px // 2, left : left + width_px // 6] = LIT
        out.append(plane[:, :width_px])
    return out


Trial = Hour | Beside | Planes


def _trials(parts: int, part_s: float, *, quick: bool) -> list[Trial]:
    """Return all trials: the default method on every size and rate, the others on the usual one."""
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


def measure(run: BenchRun) -> Made:
    """Measure the trials that are missing one by one."""
    options, (parts, part_s) = run.options, (2, 5.0) if run.options.quick else (5, 30.0)
    every = _trials(options.repeat or parts, options.duration_s or part_s, quick=options.quick)
    work = partial(_measured, seed=options.seed, films=run.folder / FILMS)
    records = run.in_turn({trial.key: (trial,) for trial in every}, work, RESULTS)
    return Made(_tabulated(records), _text)


def _measured(trial: Trial, seed: int, films: Path) -> Record:
    """Measure a trial; return its record."""
    load = os.getloadavg()[0]
    found = trial.measure(seed, films) if isinstance(trial, Beside) else trial.measure(seed)
    kind = type(trial).__name__.lower()
    return {
        "version": VERSION, "kind": kind, "load": load, "rsenf": __version__, **found,
    }  # fmt: skip


def _tabulated(records: Sequence[Record]) -> dict[str, Any]:
    of = {kind: [r for r in records if r["kind"] == kind] for kind in ("hour", "beside", "planes")}
    return {
        "table": "tracker",
        "loads": loads_of(records),
        "versions": sorted({r["rsenf"] for r in records}),
        "rows": [_hour(r) for r in of["hour"]],
        "beside": [row for r in of["beside"] for row in _beside(r)],
        "planes": [_planes_row(r) for r in of["planes"]],
    }


def _hour(record: Record) -> Row:
    cpu_s = median(record["cpu_s_per_hour"])
    ms = 1e3 * cpu_s / 3600.0 / record["frame_rate_hz"]
    return record | {"cpu_s_per_hour": cpu_s, "ms_per_frame": ms}


def _beside(record: Record) -> list[Row]:
    parts = [p | {"after": sum(p[name] for name in AFTER)} for p in record["ms_per_s"]]
    return [
        {
            "stage": name,
            "ms_per_s": median(p[name] for p in parts),
            "over_decode": median(p[name] / p["decode"] for p in parts),
        }
        for name in parts[0]
    ]


def _planes_row(record: Record) -> Row:
    rounds = record["us"]
    over = {f"{name}_over_copy": median(r[name] / r["copy"] for r in rounds) for name in _SAMPLED}
    us = {f"{name}_us": median(r[name] for r in rounds) for name in rounds[0]}
    return {"size": record["size"]} | us | over


def _text(document: Row, *, on_page: bool = False) -> str:
    tables = (
        table_of("An hour of video", _HOUR, document["rows"]),
        table_of("Beside decoding 1080p", _BESIDE, document["beside"]),
        table_of("Beside copying a plane", _PLANES, document["planes"]),
    )
    load = load_said(document)
    return titled(tables, [load] if on_page else [_NOTE, load], on_page=on_page)


_HOUR: tuple[Column, ...] = (
    ("method", "method"),
    ("settings", lambda r: ", ".join(f"{name} {v:g}" for name, v in r["settings"].items())),
    ("rows", "rows"), ("frames/s", "frame_rate_hz", "g"), ("hours", "hours", ".2g"),
    ("s an hour", "cpu_s_per_hour", ".1f"), ("ms a frame", "ms_per_frame", ".3f"),
    ("MB", "peak_mb", ".0f"),
)  # fmt: skip
_BESIDE: tuple[Column, ...] = (
    ("stage", "stage"), ("ms a second", "ms_per_s", ".2f"), ("÷ decode", "over_decode", ".2%"),
)  # fmt: skip
_PLANES: tuple[Column, ...] = (
    ("plane", "size"), ("copy", "copy_us", ".0f"),
    ("read", "read_us", ".0f"), ("÷ copy", "read_over_copy", ".2f"),
    ("row means", "means_us", ".0f"), ("÷ copy", "means_over_copy", ".2f"),
    ("mask, still", "still_us", ".0f"), ("÷ copy", "still_over_copy", ".2f"),
    ("mask, moving", "moving_us", ".0f"), ("÷ copy", "moving_over_copy", ".2f"),
)  # fmt: skip
