"""What is true of a simulated clip: enough to judge any estimator by."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rsenf.model.exposures import Capture

VERSION = 1
MEAN_S = 1.0
_CLOCK = (
    "true seconds since row 0 of the first frame began; each enf_hz is the grid's mean over "
    "[t_s - 0.5, t_s + 0.5), in true Hz. read_out_time_s and duration_s are in the camera's clock, "
    "which counts (1 + clock_ppm/1e6) seconds in a true second"
)


def truth_of(capture: Capture) -> dict[str, Any]:
    """Return the truth of a capture as plain values, ready for JSON.

    ``reference_start_s`` is the start of the first frame less the beginning of the grid path's
    first sample, so it is the lag that a time-of-recording search should find.
    """
    shutter, grid = capture.model.shutter, capture.grid
    begin_s = np.arange(math.floor(capture.true_duration_s / MEAN_S), dtype=np.float64) * MEAN_S
    gaps = grid.gaps_within(capture.true_duration_s)
    return {
        "version": VERSION,
        "seed": capture.seed,
        "frames": capture.delivered,
        "frame_rate": str(shutter.frame_rate),
        "frame_rate_hz": float(shutter.frame_rate),
        "duration_s": capture.duration_s,
        "nominal_hz": grid.nominal_hz,
        "idle_ratio": shutter.idle_ratio,
        "read_out_time_s": shutter.read_out_time_s,
        "clock_ppm": shutter.clock_ppm,
        "reference_start_s": grid.start_s,
        "light_phase_rad": capture.phase_rad,
        "effects": capture.model.effects(),
        "dropped_frames": capture.dropped.tolist(),
        "bridged_gaps_s": [list(gap) for gap in gaps],
        "notes": [
            f"the grid path has no value from {a:g} to {b:g} s; the light follows a line there"
            for a, b in gaps
        ],
        "t_s_clock": _CLOCK,
        "t_s": (begin_s + MEAN_S / 2).tolist(),
        "enf_hz": grid.mean_hz(begin_s, begin_s + MEAN_S).tolist(),
        "model": capture.model.to_dict(),
    }
