"""Simulates row means without pixels, minutes of video in seconds; and a clip's ground truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.model.capture_model import CaptureModel
from rsenf.model.exposures import Capture, ExposedBlock
from rsenf.model.grid import FloatArray, GridPath
from rsenf.model.noise import QUANTISATION_VAR, WHITE, Float32Array, generator
from rsenf.model.scene import strip_edges

VERSION = 2
MEAN_S = 1.0
_CLOCK = (
    "true seconds since line 0 of the first frame began; each enf_hz is the grid's mean over "
    "[t_s - 0.5, t_s + 0.5), in true Hz. read_out_time_s, exposure_s, duration_s and the stamps "
    "are in the camera's clock, which counts (1 + clock_ppm/1e6) seconds in a true second"
)


def truth_of(capture: Capture) -> dict[str, Any]:
    """Return the ground truth of a capture as plain values, ready for JSON.

    ``reference_start_s`` is the start of the first frame minus the beginning of the grid path's
    first sample: the lag that a time-of-recording search should find. ``idle_ratio`` and
    ``read_out_time_s`` are those of the picture, after any crop. ``frame_start_s`` holds the true
    start of each delivered frame, or null if captured frame ``n`` begins at ``n / frame_rate_hz``
    camera seconds.
    """
    model, grid, clip = capture.model, capture.grid, capture.clip
    rate_hz = float(model.shutter.frame_rate)
    begin_s = np.arange(math.floor(capture.true_duration_s / MEAN_S), dtype=np.float64) * MEAN_S
    gaps = grid.gaps_within(capture.true_duration_s)
    return {
        "version": VERSION,
        "seed": capture.seed,
        "frames": capture.delivered,
        "frame_rate": str(model.shutter.frame_rate),
        "frame_rate_hz": rate_hz,
        "duration_s": capture.duration_s,
        "nominal_hz": grid.nominal_hz,
        "read_out_axis": "columns" if model.shutter.read_out == "columns" else "rows",
        "idle_ratio": round(1 - capture.read_out_s * rate_hz, 12),
        "read_out_time_s": capture.read_out_s,
        "exposure_s": capture.exposure_s,
        "clock_ppm": round((capture.clock_factor - 1) * 1e6, 6),
        "reference_start_s": grid.start_s,
        "light_phase_rad": capture.phase_rad,
        "effects": model.named_effects(2 * grid.nominal_hz),
        "dropped_frames": clip.dropped().tolist(),
        "duplicated_frames": clip.duplicated().tolist(),
        "frame_start_s": (
            (clip.start_s[clip.number] / capture.clock_factor).tolist() if clip.irregular else None
        ),
        "bridged_gaps_s": [list(gap) for gap in gaps],
        "notes": [
            f"the grid path has no value from {a:g} to {b:g} s; the light follows a line there"
            for a, b in gaps
        ],
        "t_s_clock": _CLOCK,
        "t_s": (begin_s + MEAN_S / 2).tolist(),
        "enf_hz": grid.mean_hz(begin_s, begin_s + MEAN_S).tolist(),
        "model": model.to_dict(),
    }


@dataclass(frozen=True, eq=False)
class RowData:
    """Row means of a clip and their ground truth.

    If the read-out runs along the columns, 'rows' are columns, from left to right.
    """

    frame_time_s: FloatArray  # (frames,) presentation time, camera's clock
    level: NDArray[np.float32]  # (frames, rows, strips) 8-bit levels
    capture: Capture

    @cached_property
    def truth(self) -> dict[str, Any]:
        """The ground truth, computed on demand: fits simulate hundreds of times."""
        return truth_of(self.capture)


def simulate_rows(
    model: CaptureModel,
    grid: GridPath,
    duration_s: float,
    seed: int,
    *,
    strips: int = 1,
    noise: bool = True,
    averaged_rows: int = 1,
    progress: Callable[[int], None] | None = None,
) -> RowData:
    """Simulate the row means of a clip, before any codec.

    The noise of a mean is that of a pixel over the square root of their number. Quantisation to 8
    bits counts as noise of variance 1/12 level², which holds if the sensor's noise is at least half
    a level. Clipping is applied to the means; that of single pixels above white is neglected.

    Parameters
    ----------
    model : CaptureModel
        The capture; its codec isn't used.
    grid : GridPath
        The grid's frequency, and where on it the camera starts.
    duration_s : float
        Length of the clip by the camera's clock.
    seed : int
        Seed of all random numbers.
    strips : int, optional
        Number of strips that each row is divided into, left to right.
    noise : bool, optional
        Whether to add the sensor's noise; without, rows are expected values.
    averaged_rows : int, optional
        Number of neighbouring rows that each line is the mean of; the shutter's ``rows`` are lines.
    progress : callable, optional
        Called with the number of frames done, after each block.

    Raises
    ------
    UsageError
        When the model isn't valid, or the clip doesn't fit on the grid path.

    Examples
    --------
    >>> import rsenf.model as m
    >>> model = m.CaptureModel(shutter=m.Shutter(rows=16, columns=32))
    >>> simulate_rows(model, GridPath([50.0, 50.0]), 1.0, seed=1).level.shape
    (30, 16, 1)
    """
    capture = Capture(model, grid, duration_s, seed, averaged_rows)
    lines, across_px = model.shutter.lines, model.shutter.across_px
    if not 1 <= strips <= across_px:
        raise UsageError(f"{strips} strips don't fit in {across_px} pixels")
    view = capture.chain().view()
    places = view.strip_places(strips)
    pixels = np.diff(strip_edges(across_px, strips)).astype(np.float32)
    level = np.empty((capture.delivered, lines, strips), np.float32)
    done = 0
    for exposed in capture.exposures(noise=noise):
        part = slice(done, done + exposed.index.size)
        if exposed.index.size:
            means = view.strip_means(exposed.start_s, exposed.shift_px, exposed.across_px, strips)
            light, clean = exposed.light, level[part]
            for strip in range(strips):  # numpy is slow along a short last axis
                lit = light.level
                if light.slope is not None:
                    lit = lit + light.slope * places[:, strip]
                np.multiply(means[:, :, strip], lit, out=clean[:, :, strip])
            if noise:
                variance = model.sensor.variance(clean, capture.exponent) + QUANTISATION_VAR
                clean += np.sqrt(variance / pixels) * _unit_noise(seed, exposed, clean.shape)
            if light.offset is not None:
                clean += light.offset[:, None]
            np.clip(clean, 0, WHITE, out=clean)
        done = part.stop
        if progress is not None:
            progress(done)
    return RowData(capture.clip.stamp_s(), level, capture)


def _unit_noise(seed: int, exposed: ExposedBlock, shape: tuple[int, ...]) -> Float32Array:
    """Draw noise for every captured frame, so that a duplicated frame repeats its noise."""
    rng = generator(seed, "row noise", exposed.block)
    drawn = rng.standard_normal((exposed.captured, *shape[1:]), dtype=np.float32)
    return np.asarray(drawn[exposed.index])
