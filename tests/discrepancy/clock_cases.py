"""Recordings by cameras whose clock is off, each beside a reference of the grid it filmed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy import Film, GridDiscovery, beside_of, discover_grid
from rsenf.match.series import Grid
from rsenf.messages import EnfEstimate, Header
from rsenf.model import CaptureModel, Light, Shutter, simulate_rows, synthetic_grid
from rsenf.rows.luminance import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker

SECONDS, REFERENCE_S, START_S = 60.0, 180, 40.4
SHUTTER = Shutter(rows=48, idle_ratio=0.38)
PLAIN = CaptureModel(name="plain", light=Light(lamp="tone"), shutter=SHUTTER)


def track(
    times_s: np.ndarray, level: np.ndarray, axis: str = "rows", method: str = "projection"
) -> list[EnfEstimate]:
    """Read a film."""
    tracker = make_tracker(TrackSettings(method=method, nominal_hz=50.0))
    blocks = blocks_from_luminance(level, times_s, Header(), read_out_axis=axis)
    return [e for block in blocks for e in tracker.update(block)] + tracker.flush()


@dataclass(frozen=True, eq=False)
class Filmed:
    """A recording's estimates, and the grid while it was made, one value a second."""

    estimates: list[EnfEstimate]
    duration_s: float
    grid_hz: np.ndarray

    def discover(self, freq_hz: np.ndarray, model: CaptureModel = PLAIN) -> GridDiscovery:
        """Run the workflow beside a reference."""
        grid = Grid("grid", 50.0, 0, 1.0, freq_hz)
        film = Film(track, self.duration_s, frame_means=False)
        return discover_grid(model, beside_of(film, model, self.estimates, grid))


def filmed(clock_ppm: float, *, seed: int, noise_hz: float = 3e-4) -> Filmed:
    """Film a wall by a camera whose clock is fast; the reference has white noise."""
    path = synthetic_grid(seed, REFERENCE_S, start_s=START_S)
    model = PLAIN.with_effect("exposure", exposure_s=0.002)
    if clock_ppm:
        model = model.with_effect("clock_skew", clock_ppm=clock_ppm)
    made = simulate_rows(model, path, SECONDS, seed)
    noise = noise_hz * np.random.default_rng(seed).standard_normal(REFERENCE_S)
    return Filmed(track(made.frame_time_s, made.level), SECONDS, path.freq_hz[:REFERENCE_S] + noise)
