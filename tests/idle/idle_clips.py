"""Simulated clips, and what the idle stage makes of them."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import Header, IdleEstimate
from rsenf.model import (
    CaptureModel,
    GridPath,
    Light,
    RowData,
    Scene,
    Shutter,
    parse_frame_rate,
    simulate_rows,
    synthetic_grid,
)
from rsenf.rows.stage import blocks_from_luminance


def camera(
    frame_rate: str = "29.97",
    *,
    idle: float = 0.3,
    rows: int = 240,
    read_out: str = "rows",
    light: Light | None = None,
    scene: Scene | None = None,
) -> CaptureModel:
    """Return a small camera in front of a lamp."""
    return CaptureModel(
        light=light or Light(),
        scene=scene or Scene(),
        shutter=Shutter(
            frame_rate=parse_frame_rate(frame_rate),
            rows=rows,
            columns=320,
            idle_ratio=idle,
            read_out=read_out,
        ),
    )


def film(
    model: CaptureModel,
    seed: int,
    *,
    seconds: float = 40.0,
    nominal_hz: float = 50.0,
    grid: GridPath | None = None,
) -> RowData:
    """Film on a grid of its own."""
    grid = grid or synthetic_grid(seed, seconds + 2, nominal_hz=nominal_hz)
    return simulate_rows(model, grid, seconds, seed, strips=2)


def estimates(
    level: NDArray[np.floating],
    frame_time_s: NDArray[np.float64],
    *,
    block_frames: int = 8,
    read_out_axis: str = "rows",
    effort: str = "",
    **settings: Any,
) -> list[IdleEstimate]:
    """Run the stage over rows; return all its estimates."""
    stage = make_idle(IdleSettings(**settings))
    out: list[IdleEstimate] = []
    for block in blocks_from_luminance(
        level,
        frame_time_s,
        Header(source="test/cam"),
        block_frames=block_frames,
        read_out_axis=read_out_axis,
    ):
        out += stage.update(dataclasses.replace(block, effort=effort))
    return out + stage.flush()


def last(data: RowData, **settings: Any) -> IdleEstimate:
    """Return the last estimate of a clip."""
    return estimates(data.level, data.frame_time_s, **settings)[-1]


def error_points(estimate: IdleEstimate, data: RowData) -> float:
    """Error in percentage points of idle."""
    return 100.0 * (estimate.idle_ratio - float(data.truth["idle_ratio"]))


def std_points(estimate: IdleEstimate) -> float:
    """Return its standard error, in the same."""
    return 100.0 * float(np.sqrt(estimate.idle_ratio_var))
