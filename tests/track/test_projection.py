"""The coherent projection as an ENF estimator: marks, honest errors, no false claims."""

from __future__ import annotations

import dataclasses
import itertools
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rsenf.messages import EnfEstimate, Header, canonical
from rsenf.model import CaptureModel, GridPath, Light, Shutter, simulate_rows, synthetic_grid
from rsenf.model.row_level import RowData
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track.method import TrackSettings
from rsenf.track.projection import ProjectionTracker
from rsenf.track.stft import StftTracker

RATE_HZ = 30000 / 1001


def track(
    level: NDArray[np.float32], t: NDArray[np.float64], **settings: object
) -> list[EnfEstimate]:
    stage = ProjectionTracker(TrackSettings(method="projection", **settings))  # type: ignore[arg-type]  # checked inside
    level = level if level.ndim == 3 else level[:, :, None]
    blocks = blocks_from_luminance(level, t, Header(source="t/c"))
    return [*itertools.chain.from_iterable(map(stage.update, blocks)), *stage.flush()]


def film(
    rate: str = "30000/1001",
    *,
    nominal_hz: float = 50.0,
    seconds: float = 60.0,
    seed: int = 1,
    lamp: str = "led",
    **shutter: object,
) -> RowData:
    shape = {"rows": 120, "columns": 160} | shutter
    made = Shutter(frame_rate=Fraction(rate), **shape)  # type: ignore[arg-type]  # test's own
    grid = synthetic_grid(seed, seconds + 5, nominal_hz=nominal_hz)
    return simulate_rows(CaptureModel(shutter=made, light=Light(lamp=lamp)), grid, seconds, seed)


def errors(estimates: list[EnfEstimate], clip: RowData) -> NDArray[np.float64]:
    truth = np.array(clip.truth["enf_hz"])
    at = {round(t, 3): k for k, t in enumerate(clip.truth["t_s"])}
    known = [e for e in estimates if e.usable and round(e.t_s, 3) in at]
    assert len(known) >= 0.8 * truth.size
    return np.array([e.enf_hz - truth[at[round(e.t_s, 3)]] for e in known])


@pytest.mark.parametrize(
    ("rate", "nominal_hz"),
    [
        *((r, n) for r in ("24", "25", "30", "50", "60") for n in (50.0, 60.0)),
        ("30000/1001", 50.0),
        ("30000/1001", 60.0),
        ("24000/1001", 60.0),
        ("60000/1001", 60.0),
        ("120", 60.0),
    ],
)
def test_every_frame_rate_on_both_grids(rate: str, nominal_hz: float) -> None:
    clip = film(rate, nominal_hz=nominal_hz, seed=11)
    estimates = track(clip.level, clip.frame_time_s)
    assert [round(e.t_s, 6) for e in estimates] == [k + 0.5 for k in range(60)]
    assert all(e.usable for e in estimates)
    assert {e.nominal_hz for e in estimates} == {nominal_hz}
    assert np.sqrt(np.mean(errors(estimates, clip) ** 2)) < 1e-4
    assert abs(estimates[-1].idle_ratio - 0.38) < 0.01


@pytest.mark.parametrize("read_out", ["columns", "reverse", "global"])
def test_other_ways_of_reading_out(read_out: str) -> None:
    kind = "rows" if read_out == "reverse" else read_out
    clip = film(seed=12, read_out=kind)
    level = clip.level[:, ::-1] if read_out == "reverse" else clip.level
    estimates = track(np.ascontiguousarray(level), clip.frame_time_s)
    assert all(e.usable for e in estimates)
    assert np.sqrt(np.mean(errors(estimates, clip) ** 2)) < 1e-4


def test_frame_means_are_enough() -> None:
    clip = film(seed=13, idle_ratio=0.45, lamp="halogen")
    level = clip.level.mean(axis=1, keepdims=True)
    estimates = track(level, clip.frame_time_s)
    assert all(e.usable for e in estimates)
    assert np.sqrt(np.mean(errors(estimates, clip) ** 2)) < 5e-4
    assert all(np.isnan(e.idle_ratio) for e in estimates)


def test_stated_errors_are_true() -> None:
    """Errors over standard errors, in noise much stronger than a camera's."""
    scaled = []
    for seed in range(20, 24):
        clip = film(seed=seed, seconds=50.0)
        noise = np.random.default_rng(seed).normal(0, 25.0, clip.level.shape)
        level = (clip.level + noise).astype(np.float32)
        estimates = track(level, clip.frame_time_s)
        away = errors(estimates, clip)
        std = np.sqrt([e.enf_var_hz2 for e in estimates if e.usable])
        scaled.append(away / std[: away.size])
    assert 0.75 < np.sqrt(np.mean(np.concatenate(scaled) ** 2)) < 1.3


def test_never_worse_than_the_papers_estimator() -> None:
    clip = film(seed=31)
    noise = np.random.default_rng(31).normal(0, 20.0, clip.level.shape)
    level = (clip.level + noise).astype(np.float32)
    stage = StftTracker()
    blocks = blocks_from_luminance(level, clip.frame_time_s, Header())
    paper = [*itertools.chain.from_iterable(map(stage.update, blocks)), *stage.flush()]
    truth = np.array(clip.truth["enf_hz"])
    plain = [e.enf_hz - np.interp(e.t_s, clip.truth["t_s"], truth) for e in paper if e.usable]
    ours = errors(track(level, clip.frame_time_s), clip)
    assert np.std(ours) < np.std(plain)


def test_amplitudes_are_the_lights() -> None:
    grid = GridPath(np.full(60, 50.01))
    made = Shutter(rows=120, columns=160)
    clip = simulate_rows(CaptureModel(shutter=made), grid, 40.0, 14)
    estimates = track(clip.level, clip.frame_time_s)
    amplitude = np.array([complex(e.amplitude_re[0], e.amplitude_im[0]) for e in estimates])
    t = np.array([e.amplitude_pts_ns[0] for e in estimates]) / 1e9
    slope_hz = np.polyfit(t, np.unwrap(np.angle(amplitude)), 1)[0] / (2 * np.pi)
    assert abs(slope_hz - 0.02) < 1e-4
    assert {e.carrier_hz for e in estimates} == {100.0}
    assert np.all(np.abs(np.abs(amplitude) / 11.0 - 1) < 0.15)
    beside = amplitude * np.exp(-2j * np.pi * slope_hz * t)
    stated = np.sqrt(np.mean([e.amplitude_var_re[0] for e in estimates]))
    assert np.std(beside) < 3 * stated + 1e-3


def test_messages_do_not_depend_on_when_they_are_asked_for() -> None:
    clip = film(seed=15, seconds=36.0)
    streamed = [canonical(e) for e in track(clip.level, clip.frame_time_s)]
    again = [canonical(e) for e in track(clip.level, clip.frame_time_s)]
    assert streamed == again
    assert len(streamed) == 36


def drift(kind: str, seed: int, frames: int, rows: int) -> NDArray[np.float64]:
    """Row means without mains light."""
    rng = np.random.default_rng(seed)
    t, x = np.arange(frames) / RATE_HZ, np.arange(rows) / rows
    noise = rng.normal(0, 0.5, (frames, rows))
    walk = np.cumsum(rng.normal(0, 1, frames))[:, None]
    if kind == "noise":
        return 100 + 2 * noise
    if kind == "black":
        return np.full((frames, rows), 16.0)
    if kind == "clouds":
        return 100 + 0.3 * walk * (1 + 0.3 * np.cos(4 * np.pi * x)) + noise
    wall = np.cumsum(rng.normal(0, 2, 8000))
    if kind == "shake":
        near = np.clip(x * rows + 4000 + 2 * rng.normal(0, 1, (frames, 1)), 0, 7999)
    else:
        near = (x * rows + 20 * t[:, None] + 4000) % 7999  # a slow pan
    return 100 + np.interp(near, np.arange(8000), wall) + noise


@pytest.mark.parametrize("kind", ["noise", "black", "clouds", "shake"])
@pytest.mark.parametrize("rate_hz", [RATE_HZ, 25.0])
def test_nothing_is_claimed_without_mains_light(kind: str, rate_hz: float) -> None:
    for seed in range(3):
        level = drift(kind, 600 + seed, int(40 * rate_hz) + 1, 40).astype(np.float32)
        estimates = track(level, np.arange(len(level)) / rate_hz)
        assert len(estimates) == 40
        assert not any(e.usable for e in estimates), (seed, kind)
        assert all(e.reason and np.isnan(e.enf_hz) for e in estimates)


@pytest.mark.measured
def test_real_camera_against_a_photodiode(measured_data: Path) -> None:
    """Frame means of a static clip, smoothed as its reference is, after the clock's offset."""
    clip = np.load(measured_data / "gopro_luminance" / "exp_HAL_150cm_wall.npz")
    level = clip["luminance"][: round(240 * RATE_HZ), None].astype(np.float32)
    estimates = track(level, np.arange(len(level)) / RATE_HZ)
    middle = estimates[5:-5]
    assert all(e.usable for e in middle)
    weights = np.hanning(22)[1:-1]
    smooth = np.convolve([e.enf_hz for e in middle], weights / weights.sum(), "valid")
    reference = clip["photodiode_enf_combined_hz"] / 2
    best = np.inf
    for lag in np.arange(0, reference.size - smooth.size, 0.25):
        there = np.interp(lag + np.arange(smooth.size), np.arange(reference.size), reference)
        away = smooth - there
        best = min(best, float(np.mean(np.abs(away - away.mean()))))
    assert best < 0.3e-3


def test_flicker_is_as_faint_in_a_film_that_begins_black() -> None:
    rng, rate_hz, frames, rows = np.random.default_rng(1), 29.97, 900, 240
    time_s = np.arange(frames) / rate_hz
    line_s = time_s[:, None] + np.arange(rows) / rows * 0.7 / rate_hz
    level = 120 * (1 + 5e-5 * np.cos(2 * np.pi * 100.02 * line_s))
    level += rng.normal(0, 0.02, level.shape)
    level[:8] *= 0.005
    first, *others = blocks_from_luminance(level[:, :, None], time_s, Header(run_id="r"))
    tracker = ProjectionTracker(TrackSettings(nominal_hz=50.0))
    blocks = [dataclasses.replace(first, usable=False, reason="black"), *others]
    found = [estimate for block in blocks for estimate in tracker.update(block)]
    found += tracker.flush()
    assert not any(estimate.usable for estimate in found)
    assert any("hardly any flicker" in estimate.reason for estimate in found)
