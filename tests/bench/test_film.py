"""Filming: one pass gives the rows of every coding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rsenf.bench.measure import Filmed, film
from rsenf.bench.scenes import SceneClip, grid_for, setting_of
from rsenf.model import render_frames

CLIP = SceneClip("lit", "240p", "29.97", 50.0, 3, 2.0, ("lossless", "400k", "50k", "vp9-300k"))


@pytest.fixture(scope="module")
def filmed() -> Filmed:
    grid, _ = grid_for(None, 50.0, 2.0, CLIP.generator("grid"))
    return film(setting_of(CLIP), grid, CLIP.duration_s, CLIP.codings)


def levels(filmed: Filmed, coding: str) -> np.ndarray:
    return np.concatenate([block.level for block in filmed.blocks[coding]])


def test_lossless_rows_are_those_of_the_rendered_frames(filmed: Filmed) -> None:
    setting = setting_of(CLIP)
    grid, _ = grid_for(None, 50.0, 2.0, CLIP.generator("grid"))
    frames = [f.astype(float) for _, f in render_frames(setting.model, grid, 2.0, setting.seed)]
    means = np.stack([frame.mean(axis=1) for frame in frames])
    # Strips are as wide as each other within a pixel or two.
    assert levels(filmed, "lossless").mean(axis=2) == pytest.approx(means, abs=0.05)


def test_every_coding_has_every_frame_at_its_time(filmed: Filmed) -> None:
    stamps = {
        coding: np.concatenate([block.frame_pts_ns for block in blocks])
        for coding, blocks in filmed.blocks.items()
    }
    assert set(stamps) == set(CLIP.codings)
    for stamp in stamps.values():
        assert np.array_equal(stamp - stamp[0], stamps["lossless"] - stamps["lossless"][0])
        assert stamp.size == filmed.truth["frames"]


def test_fewer_bits_stray_further(filmed: Filmed) -> None:
    first = levels(filmed, "lossless")
    few, many = (np.std(levels(filmed, coding) - first) for coding in ("50k", "400k"))
    assert 0 < many < few


def test_synthetic_grid_where_there_is_no_data() -> None:
    grid, name = grid_for(None, 60.0, 5.0, np.random.default_rng(1))
    assert name == "synthetic"
    assert grid.nominal_hz == 60.0


@pytest.mark.measured
@pytest.mark.parametrize("nominal_hz", [50.0, 60.0])
def test_measured_grids_begin_at_random_times(measured_data: Path, nominal_hz: float) -> None:
    starts = set()
    for seed in range(4):
        grid, name = grid_for(measured_data, nominal_hz, 60.0, np.random.default_rng(seed))
        assert name.startswith("grid_")
        assert grid.nominal_hz == nominal_hz
        assert grid.length_s > 60.0
        starts.add(grid.start_s)
    assert len(starts) == 4
