"""Texture and flicker at an alias of 0 Hz: against the simulator's truth, and invariances."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.flicker.zero_alias import ZeroAlias, separate
from rsenf.idle.moments import RowBins
from rsenf.model import (
    CaptureModel,
    Codec,
    GridPath,
    Light,
    Shutter,
    render_frames,
    simulate_rows,
    synthetic_grid,
    write_video,
)

Float = NDArray[np.float64]
AnyFloat = NDArray[np.floating]
DURATION_S = 40


@dataclass(frozen=True)
class Clip:
    """Binned rows, and what is true of them."""

    level: Float
    t_s: Float
    frames: Float
    turns: float
    grid: GridPath
    read_out_s: float

    def separate(self) -> ZeroAlias:
        found = separate(self.level, self.t_s, self.frames)
        assert found is not None
        return found

    def rate_hz(self, edges_s: Float) -> Float:
        """How far the light is from its nominal frequency, half a read-out after the frames."""
        edges_s = edges_s + self.read_out_s / 2
        return 2 * (self.grid.mean_hz(edges_s[:-1], edges_s[1:]) - self.grid.nominal_hz)


def model_of(lamp: str, fps: int, idle: float, rows: int = 360, columns: int = 320) -> CaptureModel:
    shutter = Shutter(frame_rate=Fraction(fps), idle_ratio=idle, rows=rows, columns=columns)
    return CaptureModel(light=Light(lamp=lamp), shutter=shutter)


def grid_turning(seed: int, nominal_hz: float, span_rad: float | None) -> GridPath:
    """Return a grid path whose deviation turns the light's phase by so much in the clip."""
    grid = synthetic_grid(seed, DURATION_S + 5, nominal_hz=nominal_hz)
    if span_rad is None:
        return grid
    deviation_hz = grid.freq_hz - nominal_hz
    span = 4 * np.pi * np.ptp(np.cumsum(deviation_hz[: DURATION_S + 1]))
    return GridPath(nominal_hz + deviation_hz * span_rad / span, nominal_hz=nominal_hz)


def clip_of(seed: int, model: CaptureModel, grid: GridPath) -> Clip:
    data = simulate_rows(model, grid, DURATION_S, seed, strips=2)
    return binned(data.frame_time_s, data.level, model, grid)


def binned(t_s: Float, level: AnyFloat, model: CaptureModel, grid: GridPath) -> Clip:
    bins = RowBins(0.0)
    bins.add(t_s, level)
    read_out_s = model.shutter.read_out_time_s
    f0_hz = 2 * float(grid.mean_hz(np.zeros(1), t_s[-1:])[0])
    return Clip(*bins.means(), f0_hz * read_out_s, grid, read_out_s)


@pytest.mark.parametrize(
    ("lamp", "fps", "idle", "span_rad"),
    [
        ("tone", 25, 0.05, None),
        ("led", 25, 0.3, 1.2),
        ("halogen", 30, 0.5, None),
        ("cfl", 25, 0.75, 2.0),
        ("incandescent", 30, 0.8, 1.2),
        ("sodium", 25, 0.4, None),
        ("led", 60, 0.4, 4.0),
    ],
)
def test_raw_rows_give_ramp_and_frequency(
    lamp: str, fps: int, idle: float, span_rad: float | None
) -> None:
    grid = grid_turning(41, 50.0 if fps == 25 else 60.0, span_rad)
    clip = clip_of(42, model_of(lamp, fps, idle), grid)
    found = clip.separate()
    assert found.determined
    assert abs(found.turns - clip.turns) < 5e-4  # hundredths of a point of the idle period
    assert abs(found.turns - clip.turns) < 4 * found.turns_std
    at = slice(4, -4, 4)
    turns = np.diff(found.phase_rad[at]) / (2.0 * np.pi)
    error_hz = turns / np.diff(found.t_s[at]) - clip.rate_hz(found.t_s[at])
    between = np.diff(np.eye(found.t_s.size)[at], axis=0) / np.diff(found.t_s[at])[:, None]
    variance_hz2 = np.diag(between @ found.phase_cov @ between.T) / (2.0 * np.pi) ** 2
    assert np.sqrt(np.mean(error_hz**2)) < 3e-4
    assert np.sqrt(np.mean(error_hz**2 / variance_hz2)) < 2.5


def test_texture_is_that_of_steady_light() -> None:
    grid = grid_turning(43, 50.0, 1.5)
    clip = clip_of(44, model_of("led", 25, 0.3), grid)
    steady = simulate_rows(
        CaptureModel(
            light=Light(daylight_ratio=1.0), shutter=model_of("led", 25, 0.3).shutter
        ),
        grid, 4, 44, strips=2,
    ).level.mean(axis=0)  # fmt: skip
    found = clip.separate()
    # Flicker of a tenth of the level stays in a mean over time.
    assert np.std(clip.level.mean(axis=0) / steady) > 0.03
    assert np.std(found.texture(clip.level, clip.frames) / steady) < 1e-3


def by_the_law(seed: int, first: float, second: float) -> tuple[float, ZeroAlias | None]:
    """Cheap rows by the same law, written out here: their turns, and what is made of them."""
    rng = np.random.default_rng(seed)
    turns, t_s = rng.uniform(0.9, 3.8), np.arange(120) * 0.5
    phase = np.cumsum(0.05 * rng.standard_normal(120)) + rng.uniform(-0.1, 0.1) * t_s
    place = (np.arange(100) + 0.5) / 100
    angle = phase[:, None] + 2 * np.pi * turns * place
    light = 1 + first * np.cos(angle) + second * np.cos(2 * angle + 1)
    level = 100 * np.exp(0.1 * rng.standard_normal(100)) * light
    return turns, separate(level + 0.3 * rng.standard_normal(level.shape), t_s)


def test_a_second_harmonic_far_larger_than_the_first_is_none() -> None:
    told = [by_the_law(seed, 0.02, 0.1) for seed in range(12)]
    known = [(turns, found) for turns, found in told if found and found.determined]
    assert len(known) > 4
    for turns, found in known:
        assert abs(found.turns - turns) < 5 * found.turns_std < 0.1


def test_errors_have_the_size_of_their_standard_errors() -> None:
    """Over noise, textures, ramps and paths."""
    scores = []
    for seed in range(40):
        turns, found = by_the_law(seed, 0.05, 0.005)
        assert found is not None
        if found.determined:
            scores.append((found.turns - turns) / found.turns_std)
    assert len(scores) > 20
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.3


def test_upside_down_is_the_mirror_image() -> None:
    """Rows from the last to the first: the same ramp, phases and read-out with other signs."""
    clip = clip_of(46, model_of("led", 25, 0.3), grid_turning(45, 50.0, None))
    found, turned = clip.separate(), Clip(**{**vars(clip), "level": clip.level[:, ::-1]}).separate()
    assert turned.turns == pytest.approx(found.turns, abs=1e-6)
    np.testing.assert_allclose(np.diff(turned.phase_rad), -np.diff(found.phase_rad), atol=1e-5)
    assert turned.read_out_s == pytest.approx(-found.read_out_s, abs=1e-4)
    assert (found.direction, turned.direction) == (1, -1)
    assert found.read_out_s == pytest.approx(clip.read_out_s, abs=4 * found.read_out_std)


def test_a_common_gain_changes_nothing() -> None:
    clip = clip_of(48, model_of("led", 25, 0.3), grid_turning(47, 50.0, 1.5))
    drift = 1 + 0.05 * np.sin(clip.t_s / 9) + 0.002 * (clip.t_s > 20)
    drifting = Clip(**{**vars(clip), "level": clip.level * drift[:, None, None]})
    assert drifting.separate().turns == pytest.approx(clip.separate().turns, abs=1e-6)


def test_daylight_on_some_rows_more_than_on_others() -> None:
    """The lamp's share in the light falls from all of it to a half, and the flicker with it."""
    clip = clip_of(54, model_of("led", 25, 0.3), grid_turning(53, 50.0, 2.0))
    texture = clip.separate().texture(clip.level, clip.frames)
    daylight = np.linspace(0, 1, 360)[:, None] * texture.mean()
    found = Clip(**{**vars(clip), "level": clip.level + daylight}).separate()
    assert found.determined
    assert abs(found.turns - clip.turns) * 25 < 0.05  # points of the idle period
    assert abs(found.turns - clip.turns) < 3 * found.turns_std


@pytest.mark.parametrize("other", [False, True], ids=["its own", "of another lamp and camera"])
def test_a_continued_flicker_is_that_found_from_the_start(other: bool) -> None:
    clip = clip_of(14, model_of("led", 25, 0.3), grid_turning(14, 50.0, 6.0))
    earlier = clip_of(15, model_of("cfl", 25, 0.6), clip.grid) if other else clip
    before = separate(earlier.level[:110], earlier.t_s[:110], earlier.frames[:110])
    rows = clip.level[30:], clip.t_s[30:], clip.frames[30:]
    anew, continued = separate(*rows), separate(*rows, before)
    assert before is not None
    assert before.determined
    assert anew is not None
    assert continued is not None
    assert abs(continued.turns - anew.turns) < 0.02 * anew.turns_std
    off = continued.phase_rad - anew.phase_rad
    assert np.ptp(off) < 0.1 * np.sqrt(np.diag(anew.phase_cov)).min()
    assert continued.turns_std == pytest.approx(anew.turns_std, rel=0.01)


def test_little_turning_is_not_determined() -> None:
    for span_rad in (0.0, 0.3, 0.8):
        clip = clip_of(50, model_of("led", 25, 0.3), grid_turning(49, 50.0, span_rad))
        found = separate(clip.level, clip.t_s, clip.frames)
        assert found is None or not found.determined


def test_drifts_along_the_rows_are_no_flicker() -> None:
    """Smooth patterns of the rows that come and go: shadows, clouds, a picture that creeps."""
    t_s, place = np.arange(120) * 0.5, (np.arange(100) + 0.5) / 100
    for seed in range(15):
        rng = np.random.default_rng(seed)
        paths = {
            0: np.cumsum(rng.standard_normal((2, 120)), axis=1) / 11,
            1: rng.standard_normal((2, 1)) * t_s / 60,
            2: np.sin(2 * np.pi * t_s / rng.uniform(5, 200, (2, 1))),
        }[seed % 3]
        order = np.arange(1, 10)
        size = rng.standard_normal((2, 9)) / order ** rng.uniform(0.5, 2)
        patterns = size @ np.cos(np.pi * order[:, None] * place + rng.uniform(0, 6, (9, 1)))
        level = 100 * np.exp(0.01 * paths.T @ patterns) + 0.05 * rng.standard_normal((120, 100))
        found = separate(level, t_s)
        assert found is None or not found.determined


def test_noise_alone_is_nothing() -> None:
    rng = np.random.default_rng(0)
    noise = 0.1 * rng.standard_normal((60, 100))
    assert separate(100 + noise, np.arange(60.0)) is None
    assert separate(np.full((60, 100), 100.0), np.arange(60.0)) is None
    assert separate(np.zeros((60, 100)), np.arange(60.0)) is None


def test_after_h264_at_50_kbit(tmp_path: Path) -> None:
    model, grid = model_of("led", 25, 0.3, rows=360, columns=640), grid_turning(51, 50.0, None)

    path = tmp_path / "clip.mp4"
    write_video(path, render_frames(model, grid, DURATION_S, 52), Codec(bitrate_bps=50_000))
    t_s, level = [], []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            assert frame.time is not None
            t_s.append(frame.time)
            level.append(frame.to_ndarray(format="gray").mean(axis=1, dtype=np.float32))
    clip = binned(np.array(t_s), np.array(level)[:, :, None], model, grid)
    found = clip.separate()
    assert found.determined
    assert abs(found.turns - clip.turns) * 25 < 0.2  # points of the idle period
    assert abs(found.turns - clip.turns) < 3 * found.turns_std


def test_arrays_that_do_not_fit_are_refused() -> None:
    with pytest.raises(UsageError, match="9 bins of rows, 8 times"):
        separate(np.ones((9, 50)), np.arange(8.0))
    with pytest.raises(UsageError, match="501 bins"):
        separate(np.ones((501, 50)), np.arange(501.0))
    with pytest.raises(UsageError, match="4 rows"):
        separate(np.ones((50, 4)), np.arange(50.0))
