"""Recordings by cameras whose clock is off, each beside a reference of the grid it filmed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsenf.discrepancy.clock_offset import (
    ClockOffsetDiscovery,
    EnfClip,
    beside_of,
    clip_of,
    clip_of_frame_means,
    discover_beside,
)
from rsenf.discrepancy.measured import measured_of
from rsenf.discrepancy.start import PLAIN
from rsenf.match.clip_phase import window_kernel
from rsenf.match.series import Grid
from rsenf.messages import Header
from rsenf.model import CaptureModel, Light, Shutter, simulate_rows, synthetic_grid
from rsenf.rows.stage import blocks_from_luminance

SECONDS, REFERENCE_S, START_S = 60.0, 180, 40.4
GIVEN = CaptureModel(
    name="given", light=Light(lamp="tone"), shutter=Shutter(rows=48, idle_ratio=0.38)
)


@dataclass(frozen=True, eq=False)
class Filmed:
    """A recording, and the grid while it was made, one value a second."""

    clip: EnfClip
    grid_hz: np.ndarray

    def discover(self, freq_hz: np.ndarray, model: CaptureModel = GIVEN) -> ClockOffsetDiscovery:
        """Run the workflow beside a reference."""
        grid = Grid("grid", 50.0, 0, 1.0, freq_hz)
        return discover_beside(model, beside_of(self.clip, grid))


def filmed(clock_ppm: float, *, seed: int, noise_hz: float = 3e-4) -> Filmed:
    """Film a wall by a camera whose clock is fast; the reference has white noise."""
    path = synthetic_grid(seed, REFERENCE_S, start_s=START_S)
    model = GIVEN.with_effect("exposure", exposure_s=0.002)
    if clock_ppm:
        model = model.with_effect("clock_skew", clock_ppm=clock_ppm)
    made = simulate_rows(model, path, SECONDS, seed)
    data = measured_of(list(blocks_from_luminance(made.level, made.frame_time_s, Header())))
    noise = noise_hz * np.random.default_rng(seed).standard_normal(REFERENCE_S)
    return Filmed(clip_of(data), path.freq_hz[:REFERENCE_S] + noise)


def gopro(
    folder: Path, name: str, reference: str, *, seconds: float = math.inf, averaged_s: float = 0.0
) -> ClockOffsetDiscovery:
    """Run the workflow on a real recording of one mean a frame, from the plain model.

    Or on its first seconds, beside the reference averaged once more.
    """
    with np.load(folder / "gopro_luminance" / f"{name}.npz") as held:
        level, rate_hz = held["luminance"], float(held["frame_rate_hz"])
        freq_hz = held[f"{reference}_enf_combined_hz"]
    level = level[: int(min(seconds * rate_hz, level.size))]
    if averaged_s:
        freq_hz = np.convolve(freq_hz, window_kernel(averaged_s, 1.0), "valid")
    # A photodiode sees the light, which flickers at twice the mains' frequency.
    grid = Grid(reference, 50.0, 0, 1.0, freq_hz / (2.0 if reference == "photodiode" else 1.0))
    blocks = blocks_from_luminance(
        level[:, None, None], np.arange(level.size) / rate_hz, Header(), read_out_axis="frame"
    )
    return discover_beside(PLAIN, beside_of(clip_of_frame_means(list(blocks), 50.0), grid))
