from __future__ import annotations

import itertools

import numpy as np
import pytest

from rsenf.model import (
    CATALOGUE,
    CaptureModel,
    GridPath,
    Light,
    Scene,
    Sensor,
    Shake,
    Shutter,
    render_frames,
    simulate_rows,
    synthetic_grid,
)
from rsenf.model.exposures import Capture

GRID = synthetic_grid(4, 30)
SMALL = Shutter(rows=160, columns=320)


def row_means(frames: object, strips: int = 1) -> np.ndarray:
    return np.array(
        [y.reshape(y.shape[0], strips, -1).mean(axis=2, dtype=np.float64) for _, y in frames]
    )


def plain(**parts: object) -> CaptureModel:
    return CaptureModel(shutter=SMALL, **parts)


RICH = (
    plain(light=Light(lamp="sodium"), scene=Scene(shake=Shake(shake_px=2.0), mean_level=80.0))
    .with_effect("gamma", exponent=0.7)
    .with_effect("second_lamp", weight=0.3)
    .with_effect("row_banding", banding_ratio=0.02)
    .with_effect("image_wobble", wobble_rows=3.0)
    .with_effect("moving_object", period_s=2.0, top_ratio=0.8)
    .with_effect("frame_drop", drops_per_min=60)
    .with_effect("frame_duplicate", duplicates_per_min=60)
    .with_effect("codec_lowpass", gain=0.3)
)
UPRIGHT = CaptureModel(
    shutter=Shutter(rows=160, columns=320, read_out="columns"), scene=Scene(shake=Shake())
).with_effect("moving_object")


@pytest.mark.parametrize(
    "model",
    [plain(), RICH, UPRIGHT, *(plain().with_effect(name) for name in CATALOGUE)],
    ids=["plain", "rich", "upright", *CATALOGUE],
)
def test_both_depths_agree_within_their_noise(model: CaptureModel) -> None:
    frames = render_frames(model, GRID, 4.0, 9)
    rows = simulate_rows(model, GRID, 4.0, 9, strips=4)
    turned = model.shutter.read_out == "columns"
    times, planes = zip(
        *((p * float(frames.time_base), y.T.copy() if turned else y.copy()) for p, y in frames),
        strict=True,
    )
    video = row_means(enumerate(planes), strips=4)
    assert frames.truth == rows.truth
    assert times == pytest.approx(rows.frame_time_s, abs=6e-7)
    assert video.shape == rows.level.shape
    exponent = Capture(model, GRID, 4.0, 9).exponent
    pixel_var = model.sensor.variance(rows.level, exponent).astype(np.float64) + 1 / 12
    scaled = (video - rows.level) / np.sqrt(2 * pixel_var * 4 / model.shutter.across_px)
    assert np.std(scaled) == pytest.approx(1.0, abs=0.03)
    assert np.max(np.abs(scaled)) < 6
    # No row, strip or frame differs systematically.
    for axes in ((0,), (0, 1), (1, 2)):
        count = np.prod([scaled.shape[a] for a in axes])
        assert np.max(np.abs(scaled.mean(axis=axes))) * np.sqrt(count) < 4.5


def test_noise_of_the_rendered_rows_is_white_and_of_the_right_size() -> None:
    dark = Light(flicker_ratio=0.0)
    model = CaptureModel(light=dark, shutter=SMALL)
    noise = row_means(render_frames(model, GRID, 12.0, 2))[:, :, 0]
    noise -= noise.mean(axis=0)
    level = simulate_rows(model, GRID, 1.0, 2).level.mean()
    variance = (float(model.sensor.variance(level)) + 1 / 12) / 320
    samples = noise.size
    assert np.var(noise) == pytest.approx(variance, rel=0.05)
    for lag in (1, 2, 3, 7, 30):
        assert abs(np.mean(noise[lag:] * noise[:-lag])) < 5 * variance / np.sqrt(samples)
    for rows in (1, 2, 16):
        assert abs(np.mean(noise[:, rows:] * noise[:, :-rows])) < 5 * variance / np.sqrt(samples)
    # Summed coherently down the frame, as the estimators do, it is still as large as it should be.
    for turns in (0, 1, 2.07, 3.5):
        ramp = np.exp(2j * np.pi * turns * np.arange(160) / 160)
        power = np.mean(np.abs(noise @ ramp) ** 2) / 160
        assert power == pytest.approx(variance, rel=0.25), turns


def test_a_frame_is_an_exact_multiple_of_the_last_without_noise() -> None:
    # Rounded once to the nearest level, clipped, neither offset nor gain.
    model = CaptureModel(
        light=Light(lamp="tone", flicker_ratio=0.9), shutter=SMALL,
        scene=Scene(mean_level=200.0), sensor=Sensor(white_e=1e6, read_noise_e=0.0),
    )  # fmt: skip
    frames = render_frames(model, GRID, 1.0, 1)
    luma = next(iter(frames))[1]
    assert luma.shape == (160, 320)
    assert luma.dtype == np.uint8
    assert luma.max() == 255
    assert luma.min() < 30


def test_pts_are_frame_numbers_with_holes_where_frames_were_dropped() -> None:
    model = CaptureModel(shutter=Shutter(rows=16, columns=16)).with_effect(
        "frame_drop", drops_per_min=300, retimed=False
    )
    frames = render_frames(model, GRID, 4.0, 1)
    pts = [p for p, _ in frames]
    assert frames.truth["dropped_frames"]
    assert pts == [n for n in range(120) if n not in frames.truth["dropped_frames"]]
    assert len(pts) == frames.frames
    assert frames.time_base * 30000 == 1001


def test_each_iteration_yields_the_same_frames() -> None:
    frames = render_frames(CaptureModel(shutter=SMALL), GRID, 1.0, 1)
    first = [y.copy() for _, y in itertools.islice(frames, 5)]
    assert all(np.array_equal(a, y) for a, (_, y) in zip(first, frames, strict=False))
    other = next(iter(render_frames(CaptureModel(shutter=SMALL), GRID, 1.0, 2)))[1]
    assert not np.array_equal(first[0], other)


def test_without_a_duration_it_films_to_the_end_of_the_path() -> None:
    grid = GridPath(np.full(100_000, 50.0), start_s=10.0)
    frames = render_frames(CaptureModel(shutter=SMALL), grid, None, 1)
    assert frames.frames == pytest.approx(99_989 * 30000 / 1001, abs=1)
    assert next(iter(frames))[0] == 0


def test_the_box_moves_and_hides_the_wall() -> None:
    still = CaptureModel(shutter=SMALL, light=Light(flicker_ratio=0.0))
    moving = still.with_effect(
        "moving_object", width_ratio=0.25, height_ratio=0.5, top_ratio=0.25, period_s=4.0
    )
    differing = []
    for (_, a), (_, b) in zip(
        render_frames(still, GRID, 2.0, 1), render_frames(moving, GRID, 2.0, 1), strict=True
    ):
        columns = np.flatnonzero((a != b).any(axis=0))
        rows = np.flatnonzero((a != b).any(axis=1))
        assert (rows[0], rows[-1]) == (40, 119)
        differing.append((int(columns[0]), int(columns[-1])))
    assert differing[0] == (0, 79)  # at the left edge
    assert differing[-1][1] > 310  # half a period later at the right one
