"""The ground truth of a simulated clip, enough to judge any estimator."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rsenf.model.exposures import Capture

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
