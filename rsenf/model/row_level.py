"""The fast depth: row means without pixels, minutes in seconds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.model.capture_model import CaptureModel
from rsenf.model.exposures import Capture
from rsenf.model.grid import FloatArray, GridPath
from rsenf.model.scene import View, strip_edges
from rsenf.model.seeds import generator
from rsenf.model.sensor import QUANTISATION_VAR, WHITE
from rsenf.model.truth import truth_of


@dataclass(frozen=True, eq=False)
class RowData:
    """Row means of a clip and what is true of it."""

    frame_time_s: FloatArray  # (frames,) presentation time, camera's clock
    level: NDArray[np.float32]  # (frames, rows, strips) 8-bit levels
    truth: dict[str, Any]


def simulate_rows(
    model: CaptureModel, grid: GridPath, duration_s: float, seed: int, *, strips: int = 1
) -> RowData:
    """Simulate the row means of a clip, before any codec.

    The noise of a mean is the pixels' own over the square root of their number; quantisation to
    eight bits counts as noise of a twelfth of a level squared, which is right where the sensor's
    noise is at least half a level.

    Parameters
    ----------
    model : CaptureModel
        The capture; its codec isn't used.
    grid : GridPath
        The grid's frequency, and where on it the camera starts.
    duration_s : float
        Length of the clip by the camera's clock.
    seed : int
        Seed of everything random.
    strips : int, optional
        Into how many strips each row is divided, left to right.

    Raises
    ------
    UsageError
        When the model isn't plausible, or the clip doesn't fit on the grid path.
    """
    capture = Capture(model, grid, duration_s, seed)
    shutter, sensor = model.shutter, model.sensor
    if not 1 <= strips <= shutter.columns:
        raise UsageError(f"{strips} strips don't fit in {shutter.columns} columns")
    view = View(model.scene, shutter.rows, shutter.columns, seed)
    pixels = np.diff(strip_edges(shutter.columns, strips)).astype(np.float32)
    level = np.empty((capture.delivered, shutter.rows, strips), np.float32)
    stamp = np.empty(capture.delivered, np.int64)
    done = 0
    for exposed in capture.exposures():
        part = slice(done, done + len(exposed.stamp))
        clean = view.strip_means(exposed.start_s, strips) * exposed.gain[:, :, None]
        noise = generator(seed, "row noise", exposed.block).standard_normal(
            clean.shape, dtype=np.float32
        )
        noise *= np.sqrt((sensor.variance(clean) + np.float32(QUANTISATION_VAR)) / pixels)
        level[part] = np.clip(clean + noise, 0, WHITE)
        stamp[part] = exposed.stamp
        done = part.stop
    return RowData(stamp / float(shutter.frame_rate), level, truth_of(capture))
