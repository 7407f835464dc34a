"""A bare capture and slow, obvious measurements on it, for tests of single effects."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.model import (
    CaptureModel,
    GridPath,
    Light,
    RowData,
    Scene,
    Sensor,
    Shutter,
    simulate_rows,
)

F0_HZ, DEPTH, PHASE, LEVEL = 100.0, 0.5, 0.4, 110.0
RATE_HZ = 30000 / 1001
STEADY = GridPath(np.full(700, 50.0))
FLAT = Scene(texture_ratio=0.0, vignetting_ratio=0.0)
QUIET = Sensor(white_e=1e6, read_noise_e=0.0)

Array = NDArray[np.float64]


def bare(scene: Scene = FLAT, flicker: float = DEPTH, **shutter: Any) -> CaptureModel:
    """Return a pure tone on a wall, 64 lines of 320 pixels, next to no noise, no effect."""
    return CaptureModel(
        light=Light(lamp="tone", flicker_ratio=flicker, phase_rad=PHASE),
        scene=scene, sensor=QUIET,
        shutter=Shutter(**{"rows": 64, "columns": 320, "idle_ratio": 0.3, **shutter}),
    )  # fmt: skip


def film(model: CaptureModel, duration_s: float = 10.0, strips: int = 1, seed: int = 1) -> RowData:
    """Simulate on a grid of exactly 50 Hz."""
    return simulate_rows(model, STEADY, duration_s, seed, strips=strips)


def line_times_s(frame_s: Array, lines: int = 64, read_out_s: float = 0.7 / RATE_HZ) -> Array:
    """Start of each line of each frame: (frames, lines)."""
    return np.asarray(frame_s)[:, None] + np.arange(lines) * (read_out_s / lines)


def wave(t_s: Array, phase_rad: float = PHASE) -> Array:
    """Return the bare lamp's light over its mean."""
    return 1 + DEPTH * np.cos(2 * np.pi * F0_HZ * t_s + phase_rad)


def fit(series: Array, t_s: Array, freqs_hz: list[float]) -> NDArray[np.complex128]:
    """Amplitudes of some tones by least squares, the mean beside them, over the mean."""
    columns = [np.ones(t_s.size)]
    for f in freqs_hz:
        columns += [np.cos(2 * np.pi * f * t_s.ravel()), -np.sin(2 * np.pi * f * t_s.ravel())]
    found = np.linalg.lstsq(np.stack(columns, axis=1), series.ravel(), rcond=None)[0]
    return np.asarray((found[1::2] + 1j * found[2::2]) / found[0])


def frame_tones(data: RowData, t_s: Array) -> NDArray[np.complex128]:
    """Flicker of each frame by itself, from least squares down its lines: (frames,)."""
    return np.array([fit(y, t, [F0_HZ])[0] for y, t in zip(data.level[:, :, 0], t_s, strict=True)])


def phase_error_rad(tones: NDArray[np.complex128]) -> Array:
    """Phase of tones against the bare lamp's."""
    return np.angle(tones * np.exp(-1j * PHASE))
