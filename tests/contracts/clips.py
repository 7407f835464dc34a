"""Clips with a known truth and clips without a signal, each made once."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import Frame, Header, RowBlock
from rsenf.model import (
    CaptureModel,
    Light,
    Scene,
    Shutter,
    parse_frame_rate,
    render_frames,
    simulate_rows,
    synthetic_grid,
)
from rsenf.rows.settings import RowsSettings
from rsenf.rows.stage import Rows, blocks_from_luminance
from tests.discrepancy.foreign_camera import simple as foreign_camera

Array = NDArray[np.float64]
SECONDS = 32.0
Cell = tuple[str, float, float]
FOREIGN: Cell = ("foreign camera", 50.0, 1.0 - foreign_camera.READ_OUT_S * foreign_camera.RATE_HZ)
# Frame rate, grid and idle ratio: the alias is away from 0 Hz, at it, near it, and on its mirror
# image.
CELLS: tuple[Cell, ...] = (
    ("29.97", 50.0, 0.38),
    ("25", 60.0, 0.38),
    ("23.976", 50.0, 0.38),
    ("24", 50.0, 0.6),
    ("25", 50.0, 0.38),
    ("30", 50.0, 0.38),
    ("59.94", 50.0, 0.38),
    ("60", 50.0, 0.38),
    ("23.976", 60.0, 0.38),
    ("29.97", 60.0, 0.2),
    ("29.97", 60.0, 0.38),
    ("50", 60.0, 0.38),
    ("59.94", 60.0, 0.38),
    FOREIGN,
)


@dataclass(frozen=True, eq=False)
class Clip:
    """Rows, and the grid's mean frequency over intervals of them."""

    blocks: tuple[RowBlock, ...]
    mean_hz: Callable[[Array, Array], Array]


@functools.cache
def clip(cell: Cell, block_frames: int = 8) -> Clip:
    """Return a raw clip: an LED of 10 % flicker on a lightly textured wall, or a foreign one."""
    rate, nominal_hz, idle_ratio = cell
    if cell == FOREIGN:
        path = {"seconds": SECONDS, "stroll_hz": 5e-4}
        level, t_s = foreign_camera.film(5, **path)
        mean_hz = functools.partial(foreign_camera.true_hz, 5, **path)
        return Clip(blocks_of(level, t_s, block_frames), mean_hz)
    shutter = Shutter(
        frame_rate=parse_frame_rate(rate), rows=60, columns=320, idle_ratio=idle_ratio
    )
    model = CaptureModel(
        light=Light(lamp="led", flicker_ratio=0.1),
        scene=Scene(texture_ratio=0.03),
        shutter=shutter,
    )
    grid = synthetic_grid(3, SECONDS + 4.0, nominal_hz=nominal_hz, start_s=1.0)
    rows = simulate_rows(model, grid, SECONDS, 3, strips=2)
    return Clip(blocks_of(rows.level, rows.frame_time_s, block_frames), grid.mean_hz)


def blocks_of(level: Array, t_s: Array, block_frames: int = 8) -> tuple[RowBlock, ...]:
    """Cut rows into blocks."""
    header = Header(source="site/cam", run_id="run")
    return tuple(blocks_from_luminance(level, t_s, header, block_frames=block_frames))


def noise() -> tuple[RowBlock, ...]:
    """Rows of sensor noise on a wall in daylight that clouds dim."""
    rng = np.random.default_rng(8)
    level = rng.uniform(80, 140, (1, 40, 2)) + rng.normal(0, 0.5, (700, 40, 2))
    clouds = 1 + 0.01 * np.cumsum(rng.normal(0, 0.05, (700, 1, 1)), axis=0)
    return blocks_of(level * clouds, np.arange(700) / 29.97)


def constant() -> tuple[RowBlock, ...]:
    """Rows that never change."""
    return blocks_of(np.full((700, 40, 2), 110.0), np.arange(700) / 29.97)


@functools.cache
def flicker_free(tile_means: bool = False) -> tuple[RowBlock, ...]:
    """Rows of frames in which somebody walks by, in light that doesn't flicker."""
    model = CaptureModel(
        light=Light(flicker_ratio=0.0), shutter=Shutter(rows=48, columns=96)
    ).with_effect("moving_object", period_s=5.0)
    frames = render_frames(model, synthetic_grid(1, 26.0), 24.0, 4)
    stage = Rows(RowsSettings(tile_means=tile_means))
    step_ns = 1e9 * float(frames.time_base)
    out: list[RowBlock] = []
    for n, (pts, luma) in enumerate(frames):
        header = Header(
            source="site/cam", pts_ns=round(pts * step_ns), seq=n, frame_first=n, frame_last=n
        )
        height, width = luma.shape
        out += stage.update(Frame(header=header, height_px=height, width_px=width, luma=luma))
    return tuple(out + stage.flush())


NOTHING_THERE = {"noise": noise, "constant": constant, "flicker_free": flicker_free}
