"""The simulator as a video source: frames of the capture model, without a codec."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rsenf.config.schemas import SimulatedInput, load_model
from rsenf.decode.source import StreamInfo, from_frames
from rsenf.model import FrameStream, GridPath, render_frames, synthetic_grid
from rsenf.reference import read_reference
from rsenf.timebase import pts_to_ns

if TYPE_CHECKING:
    from rsenf.decode.source import VideoSource


def open_simulated(
    config: SimulatedInput, source: str, run_id: str, *, pace: bool, stop: Event
) -> VideoSource:
    """Open the simulator as a source.

    Parameters
    ----------
    config : SimulatedInput
        Capture model, grid (a reference or a synthetic one), duration and seed.
    source, run_id : str
        For the headers of the frames.
    pace : bool
        Yield frames in real time, as if live.
    stop : Event
        Ends the source.
    """
    model = load_model(Path(config.model))
    if config.reference:
        measured = read_reference(config.reference, timezone=config.timezone, step_s=config.step_s)
        grid = GridPath(measured.freq_hz, measured.step_s, config.start_s, measured.nominal_hz)
    else:
        grid = synthetic_grid(config.seed, config.duration_s + 1.0, start_s=config.start_s)
    stream = render_frames(model, grid, config.duration_s, config.seed)
    info = StreamInfo(
        codec="rawvideo",
        width_px=model.shutter.columns,
        height_px=model.shutter.rows,
        declared_rate_hz=float(model.shutter.frame_rate),
        duration_s=config.duration_s,
        packets_reason="simulated frames were never compressed",
    )
    return from_frames(
        _timed(stream),
        info,
        source=source,
        run_id=run_id,
        clock_ns=time.time_ns,
        pace=pace,
        stop=stop,
    )


def _timed(stream: FrameStream) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    for ticks, luma in stream:
        yield pts_to_ns(ticks, stream.time_base), luma
