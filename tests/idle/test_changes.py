"""A read-out that changes along a recording: a zoom, or a cut to another camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import rsenf

FRAMES, ROWS, FRAME_RATE_HZ = 1400, 240, 29.7
Float = NDArray[np.float64]


def rows_of(read_out_ratio: Float, seed: int) -> Float:
    """Rows under a lamp at 50 Hz; ``read_out_ratio`` of each frame's period is in view."""
    rng = np.random.default_rng(seed)
    frame_s = np.arange(FRAMES) / FRAME_RATE_HZ
    down = (np.arange(ROWS) - ROWS / 2) / ROWS
    row_s = frame_s[:, None] + down * read_out_ratio[:, None] / FRAME_RATE_HZ
    wall = rng.uniform(80.0, 120.0, ROWS)
    level = wall * (1.0 + 0.06 * np.cos(2.0 * np.pi * 100.02 * row_s + 1.0))
    return np.asarray(level + 0.3 * rng.standard_normal(level.shape))


def idle(read_out_ratio: Float, seed: int) -> rsenf.IdleResult:
    frame_time_s = np.arange(FRAMES) / FRAME_RATE_HZ
    return rsenf.idle(rows_of(read_out_ratio, seed), frame_time_s=frame_time_s)


def test_a_steady_read_out_is_estimated() -> None:
    found = idle(np.full(FRAMES, 0.75), 5)
    assert found.verdict == "estimated"
    assert abs(found.idle_ratio - 0.25) < 4.0 * found.idle_ratio_std


def test_a_zoom_is_refused_with_its_range() -> None:
    found = idle(0.75 / np.linspace(1.0, 1.3, FRAMES), 6)
    assert found.verdict == "refused"
    assert "the read-out changes along the recording (idle 2" in found.reason


def test_a_cut_to_another_camera_is_refused() -> None:
    found = idle(np.where(np.arange(FRAMES) < 500, 0.75, 0.70), 7)
    assert found.verdict == "refused"
    assert "cut to another camera" in found.reason


def test_the_error_covers_a_read_out_that_wavers() -> None:
    """By less than a point: the error of the mean is at least that of the segments' scatter."""
    wavers = 0.75 + 0.005 * np.repeat(np.random.default_rng(8).standard_normal(11), 128)[:FRAMES]
    found, steady = idle(wavers, 8), idle(np.full(FRAMES, 0.75), 8)
    assert found.verdict == "estimated"
    assert found.idle_ratio_std > 3.0 * steady.idle_ratio_std
    assert abs(found.idle_ratio - (1.0 - wavers.mean())) < 4.0 * found.idle_ratio_std
