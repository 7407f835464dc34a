"""``rsenf discover --reference``: what it writes, of rows or frame means, and what it refuses."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from rsenf.model import CaptureModel, Light, Shutter, simulate_rows, synthetic_grid
from tests.report.html_page import Page

START_S, PPM = 30.3, 60.0
WRITTEN = ["discovery.json", "model.yaml", "report.html", "residuals.npz"]


def filmed(seconds: float, lines: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Film with a fast clock; return rows, times, and the grid, one value a second."""
    path = synthetic_grid(seed, seconds + 80.0, start_s=START_S)
    shutter = Shutter(rows=lines, columns=64, idle_ratio=0.38)
    model = CaptureModel(light=Light(lamp="tone"), shutter=shutter)
    model = model.with_effect("exposure", exposure_s=0.002)
    made = simulate_rows(model.with_effect("clock_skew", clock_ppm=PPM), path, seconds, seed)
    return made.level[:, :, 0], made.frame_time_s, path.freq_hz[: int(seconds) + 70]


def write_grid(path: Path, freq_hz: np.ndarray) -> Path:
    noise = 3e-4 * np.random.default_rng(1).standard_normal(freq_hz.size)
    path.write_text("frequency\n" + "\n".join(f"{hz:.6f}" for hz in freq_hz + noise) + "\n")
    return path


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("rows")
    level, times_s, freq_hz = filmed(60.0, 48, 61)
    np.savez(folder / "rows.npz", rows=level, frame_time_s=times_s)
    return folder / "rows.npz", write_grid(folder / "grid.csv", freq_hz)


@pytest.fixture(scope="module")
def means(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("means")
    level, _, freq_hz = filmed(330.0, 16, 62)
    np.savez(folder / "means.npz", luminance=level.mean(axis=1), frame_rate_hz=30000 / 1001)
    return folder / "means.npz", write_grid(folder / "grid.csv", freq_hz)


def discover(rsenf: Callable, clip: Path, grid: Path, out: Path, *words: object):
    return rsenf("discover", clip, "--reference", grid, "--step-s", "1", "--out", out, *words)


def test_frame_means_alone_have_a_report(rsenf: Callable, means: tuple[Path, Path]) -> None:
    out = means[0].parent / "found"
    done = discover(rsenf, *means, out)
    assert done.returncode == 0, done.stderr
    assert "clock_ppm" in done.stdout
    assert "of the reference's variance" in done.stdout
    told = json.loads((out / "discovery.json").read_text())
    (effect,) = told["effects"]
    assert effect["name"] == "clock_skew"
    off_ppm = effect["parameters"]["clock_ppm"] - PPM
    assert abs(off_ppm) < 4.0 * effect["stderr"]["clock_ppm"]
    assert told["gap"]["after"] < told["gap"]["before"] / 10.0
    assert sorted(path.name for path in out.iterdir()) == WRITTEN
    page = Page((out / "report.html").read_text())
    assert page.ids == ["reference", "numbers", "model"]
    assert len(page.all("img")) == 2
    assert f"off by {effect['parameters']['clock_ppm']:+.1f}" in page.words
    assert f"{told['gap']['before']:.2e} ± {told['gap']['before_stderr']:.1e}" in page.words
    assert f"{told['gap']['after']:.2e} ± {told['gap']['stderr']:.1e}" in page.words
    with np.load(out / "residuals.npz") as held:
        before, after = (np.nanstd(held[f"enf_{side}_hz"]) for side in ("before", "after"))
        assert after < before


def test_rows_have_the_clock_beside_what_they_tell(
    rsenf: Callable, rows: tuple[Path, Path]
) -> None:
    out = rows[0].parent / "found"
    done = discover(rsenf, *rows, out, "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told == json.loads((out / "discovery.json").read_text())
    clock = next(e for e in told["effects"] if e["name"] == "clock_skew")
    assert abs(clock["parameters"]["clock_ppm"] - PPM) < 4.0 * clock["stderr"]["clock_ppm"]
    assert told["reference"]["verdict"] == "explained"
    assert told["reference"]["lag_s"] == pytest.approx(START_S, abs=0.3)
    page = Page((out / "report.html").read_text())
    assert page.ids[-3:] == ["reference", "numbers", "model"]
    assert len(page.all("img")) == 6
    effects = yaml.safe_load((out / "model.yaml").read_text())["effects"]
    assert any("clock_skew" in effect for effect in effects)


# One of another day, and one that ends in the midst of the clip.
@pytest.mark.parametrize(("kind", "seconds"), [("means", 0), ("means", 200), ("rows", 50)])
def test_a_reference_that_does_not_cover_the_clip_is_refused(
    kind: str, seconds: int, rsenf: Callable, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    clip, grid = request.getfixturevalue(kind)
    freq_hz = np.loadtxt(grid, skiprows=1)[:seconds]
    if not seconds:
        freq_hz = synthetic_grid(99, 400.0).freq_hz
    other = write_grid(tmp_path / "other.csv", freq_hz)
    done = discover(rsenf, clip, other, tmp_path / "found")
    assert done.returncode == 1
    assert done.stdout == ""
    (line,) = [text for text in done.stderr.splitlines() if not text.startswith("note: ")]
    assert re.search("no match in the reference other|the reference other covers only", line)
    assert [path.name for path in tmp_path.iterdir()] == ["other.csv"]


def test_frame_means_without_a_reference_are_told_what_is_missing(
    rsenf: Callable, means: tuple[Path, Path], tmp_path: Path
) -> None:
    done = rsenf("discover", means[0], "--out", tmp_path / "found")
    assert done.returncode == 1
    assert "--reference" in done.stderr
    assert not list(tmp_path.iterdir())
