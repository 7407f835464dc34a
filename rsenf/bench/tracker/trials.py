"""Which costs are measured, each in a process of its own, and their records.

Row means of planes that no cache holds any more, beside copying the same bytes.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rsenf import __version__
from rsenf.batch.journal import Record
from rsenf.bench.harness import measure_in_turn
from rsenf.bench.pipeline.films import SIZES
from rsenf.bench.tracker.beside import Beside, Hour
from rsenf.messages import Frame, Header
from rsenf.model.seeds import generator
from rsenf.rows.settings import RowsSettings
from rsenf.rows.stage import Rows
from rsenf.rows.tiles import tile_sums
from rsenf.track import METHODS, TrackSettings

Luma = NDArray[np.uint8]

BLOCK_FRAMES = RowsSettings().block_frames
HELD_BYTES = 64 << 20  # planes take turns: more of them than a cache holds
LEVELS, NOISE, LIT = (70, 130), 3, 210
ALIGNED_PX = 64  # a decoder's lines begin at multiples of so many


@dataclass(frozen=True)
class Planes:
    """Planes of one size.

    Parameters
    ----------
    size : str
        Of :data:`rsenf.bench.pipeline.films.SIZES`.
    rounds, blocks : int
        How often each is timed, and on how many blocks of frames.
    """

    size: str
    rounds: int
    blocks: int

    @property
    def key(self) -> str:
        """Name that tells it from any other."""
        return f"planes {self.size} {self.rounds} x {self.blocks} blocks, read as well"

    def measure(self, seed: int) -> dict[str, Any]:
        """Time copying, reading and sampling, in turn; microseconds a plane, by round."""
        width_px, height_px = SIZES[self.size]
        still, moving = (planes(height_px, width_px, seed, box=box) for box in (False, True))
        to = np.empty_like(still[0])
        works: dict[str, tuple[list[Any], Callable[[Any], Any]]] = {
            "copy": (still, lambda luma: np.copyto(to, luma)),
            "read": (still, lambda luma: cv2.norm(luma, cv2.NORM_INF)),
            "means": (still, _row_means(width_px)),
            "still": (_frames(still), Rows().update),
            "moving": (_frames(moving), Rows().update),
        }
        for of, work in works.values():
            self._timed_us(of, work)
        return {
            "size": self.size,
            "us": [
                {name: self._timed_us(of, work) for name, (of, work) in works.items()}
                for _ in range(self.rounds)
            ],
        }

    def _timed_us(self, of: list[Any], work: Callable[[Any], Any]) -> float:
        count = self.blocks * BLOCK_FRAMES
        begun_s = time.process_time()
        for number in range(count):
            work(of[number % len(of)])
        return (time.process_time() - begun_s) / count * 1e6


def _row_means(width_px: int) -> Callable[[Luma], None]:
    """Return what takes a plane, and divides its sums when a block of planes has come."""
    sums: list[Any] = []

    def take(luma: Luma) -> None:
        sums.append(tile_sums(luma, "rows", 1))
        if len(sums) == BLOCK_FRAMES:
            np.array(sums, np.float32) / width_px
            sums.clear()

    return take


def _frames(lumas: list[Luma]) -> list[Frame]:
    height_px, width_px = lumas[0].shape
    return [
        Frame(
            header=Header(frame_first=number, frame_last=number, seq=number),
            height_px=height_px,
            width_px=width_px,
            luma=luma,
        )
        for number, luma in enumerate(lumas)
    ]


def planes(height_px: int, width_px: int, seed: int, *, box: bool) -> list[Luma]:
    """Make planes of a textured wall, as a decoder lays them in memory; a box may cross it."""
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
    work = partial(measured, seed=seed, films=folder / FILMS)
    return measure_in_turn(all_trials, work, folder / RESULTS, lambda _, trial: progress(trial.key))


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
