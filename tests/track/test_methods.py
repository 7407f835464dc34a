"""The compared methods and phase steps: against truth, in noise, and what each can't do."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.messages import EnfEstimate, Header, RowBlock, canonical
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker
from rsenf.track.stft import SMEAR_STD_HZ
from tests.track.test_track import RATE_HZ, rows_of, track

FRAME_RATE_METHODS = ("frame_mean", "superpixel")
METHODS = (*FRAME_RATE_METHODS, "row_concat", "phase")


def feed(blocks: list[RowBlock], **settings: object) -> list[EnfEstimate]:
    stage = make_tracker(TrackSettings(**settings))  # type: ignore[arg-type]  # checked inside
    return list(itertools.chain.from_iterable(map(stage.update, blocks))) + stage.flush()


def blocks_of(level: NDArray[np.float32], t: NDArray[np.float64]) -> list[RowBlock]:
    return list(blocks_from_luminance(level[:, :, None], t, Header(source="t/c")))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("nominal", "rate_hz"), [(50.0, RATE_HZ), (50.0, 24.0), (60.0, 25.0)])
def test_constant_frequency_is_found(method: str, nominal: float, rate_hz: float) -> None:
    t = np.arange(int(24 * rate_hz)) / rate_hz
    for deviation in (-0.07, 0.041):
        estimates = track(
            *rows_of(nominal + deviation, times=t, idle=0.45, noise=0.05), method=method
        )
        assert [round(e.t_s, 6) for e in estimates] == [10.0 + k for k in range(5)]
        for e in estimates:
            assert e.usable, e.reason
            assert (e.method, e.nominal_hz) == (method, nominal)
            assert abs(e.enf_hz - nominal - deviation) < 3e-4
            assert 0 < e.enf_var_hz2 < 3e-3**2


@pytest.mark.parametrize("method", METHODS)
def test_stated_errors_are_true_for_noise(method: str) -> None:
    smear_hz = 0.0 if method == "phase" else SMEAR_STD_HZ
    idle = 0.9 if method == "frame_mean" else 0.02  # what leaves each something to see
    scaled = []
    for seed in range(60):
        level, t = rows_of(50.01, seconds=20.4, rows=24, idle=idle, depth=2.0, noise=4.0, seed=seed)
        (e,) = track(level, t, method=method, nominal_hz=50.0)
        assert e.usable, e.reason
        scaled.append((e.enf_hz - 50.01) / np.sqrt(e.enf_var_hz2 - smear_hz**2))
    # 60 values: the standard deviation of their standard deviation is 0.09. What the phase's
    # variance holds for the grid's changes is of no use to a frequency that is constant.
    assert (0.4 if method == "phase" else 0.75) < np.std(scaled) < 1.3
    assert abs(np.mean(scaled)) < 0.45


@pytest.mark.parametrize("method", METHODS)
def test_streaming_equals_batch_bit_for_bit(method: str) -> None:
    level, t = rows_of(50.02, seconds=23.0)
    stage = make_tracker(TrackSettings(method=method))
    streamed = [canonical(e) for b in blocks_of(level, t) for e in stage.update(b)]
    streamed += [canonical(e) for e in stage.flush()]
    whole = list(blocks_from_luminance(level[:, :, None], t, Header(source="t/c"), block_frames=1))
    singly = feed(whole, method=method)
    assert streamed == [canonical(e) for e in track(level, t, method=method)]
    assert [e.enf_hz for e in singly] == pytest.approx(
        [e.enf_hz for e in track(level, t, method=method)], abs=1e-9
    )


@pytest.mark.parametrize("method", METHODS)
def test_false_signals_are_rare(method: str) -> None:
    """Noise alone: none may be called ENF; nor a drift of the whole picture's brightness."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        level = 100 + rng.normal(0, 1, (610, 24))
        if seed % 2:
            level += 5 * np.cumsum(rng.normal(0, 0.05, (610, 1)), axis=0)
        estimates = track(level.astype(np.float32), np.arange(610) / RATE_HZ, method=method)
        assert estimates
        assert not any(e.usable for e in estimates)
        assert all(e.reason and np.isnan(e.enf_hz) for e in estimates)


@pytest.mark.parametrize("method", METHODS)
def test_black_is_a_result(method: str) -> None:
    level = np.full((650, 24), 16.0, np.float32)
    estimates = track(level, np.arange(650) / RATE_HZ, method=method)
    assert estimates
    assert not any(e.usable for e in estimates)


@pytest.mark.parametrize("method", [*FRAME_RATE_METHODS, "phase"])
@pytest.mark.parametrize(("nominal", "rate_hz"), [(50.0, 25.0), (60.0, 30.0), (50.0, 40.0)])
def test_alias_at_the_spectrums_ends_is_refused(
    method: str, nominal: float, rate_hz: float
) -> None:
    t = np.arange(int(22 * rate_hz)) / rate_hz
    estimates = track(*rows_of(nominal + 0.06, times=t), method=method, nominal_hz=nominal)
    assert estimates
    assert not any(e.usable for e in estimates)
    words = "mirror image" if method == "phase" else "for one value a frame"
    assert all(words in e.reason for e in estimates)


def test_grid_that_one_value_a_frame_can_not_see_is_named() -> None:
    level, t = rows_of(60.0, times=np.arange(690) / 30.0)
    for method in FRAME_RATE_METHODS:
        for e in track(level, t, method=method):
            assert "60 Hz grid shows too near 0 Hz at 30.000 frames/s" in e.reason


def test_frame_means_are_all_that_frame_mean_needs() -> None:
    level, t = rows_of(50.03)
    from_rows = track(level, t, method="frame_mean", nominal_hz=50.0)
    means = level.mean(axis=1, dtype=np.float64).astype(np.float32)[:, None]
    from_means = track(means, t, method="frame_mean", nominal_hz=50.0)
    assert [e.enf_hz for e in from_rows] == [e.enf_hz for e in from_means]
    for e in track(means, t, method="row_concat"):
        assert not e.usable
        assert "no rows" in e.reason


def test_whole_turns_down_the_rows_cancel_in_the_mean_but_not_in_regions() -> None:
    idle = 1 - 2 * RATE_HZ / 100.04  # two turns of phase in the read-out time
    level, t = rows_of(50.02, idle=idle, rows=120, noise=2.0)
    assert not any(e.usable for e in track(level, t, method="frame_mean"))
    estimates = track(level, t, method="superpixel")
    assert all(e.usable and abs(e.enf_hz - 50.02) < 1e-3 for e in estimates)


def test_line_that_the_idle_period_empties_is_lost_to_row_concat() -> None:
    # Paper: the amplitude at f0 is |sinc(f0·idle/F_r)|, 0 where that is a whole number.
    idle = RATE_HZ / 100.04
    level, t = rows_of(50.02, idle=idle, rows=240, noise=2.0, depth=0.5)
    assert not any(e.usable for e in track(level, t, method="row_concat"))
    assert all(e.usable for e in track(level, t, method="stft"))


def test_region_in_which_something_moves_has_no_say() -> None:
    rng = np.random.default_rng(5)
    level, t = rows_of(50.02, depth=1.0, rows=48)
    strips = np.repeat(level[:, :, None], 4, axis=2)
    strips[:, :30, 0] += 20 * np.cumsum(rng.normal(0, 1, (t.size, 1)), axis=0)
    blocks = list(blocks_from_luminance(strips, t, Header(source="t/c")))
    estimates = feed(blocks, method="superpixel")
    assert all(e.usable and abs(e.enf_hz - 50.02) < 1e-3 for e in estimates)


def test_regions_are_the_tiles_where_there_are_any() -> None:
    level, t = rows_of(50.02, rows=48)
    tiles = level.reshape(t.size, 6, 8).copy()
    blocks = [
        dataclasses.replace(
            b,
            level=np.full_like(b.level, 90.0),  # nothing to be seen but in the tiles
            bands=6,
            tiles=8,
            tile_level=tiles[int(b.frame_number[0]) : int(b.frame_number[-1]) + 1],
        )
        for b in blocks_of(level, t)
    ]
    estimates = feed(blocks, method="superpixel")
    assert estimates
    assert all(e.usable and abs(e.enf_hz - 50.02) < 1e-3 for e in estimates)


def wandering(seconds: float, *, upward: bool = False, idle: float = 0.3) -> tuple[
    NDArray[np.float32], NDArray[np.float64]
]:  # fmt: skip
    """Rows under a grid that swings by 20 mHz in 16 s; see :func:`swing_hz`."""
    rng = np.random.default_rng(3)
    t = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    down = np.arange(80) / 80 * (1 - idle) / RATE_HZ
    at = t[:, None] + (down[::-1] if upward else down)
    cycles = 50.0 * at - 0.005 * 16 / (2 * np.pi) * np.cos(2 * np.pi * at / 16)
    level = rng.uniform(80, 140, 80) + 5 * np.cos(4 * np.pi * cycles + 1.0)
    return (level + rng.normal(0, 0.1, level.shape)).astype(np.float32), t


def swing_hz(t_s: float) -> float:
    """Mean of the swinging grid over a second, by its exact integral."""
    edges = np.cos(2 * np.pi * (np.array([t_s - 0.5, t_s + 0.5])) / 16)
    return float(50.0 - 0.005 * 16 / (2 * np.pi) * (edges[1] - edges[0]))


@pytest.mark.parametrize("upward", [False, True])
@pytest.mark.parametrize("idle", [0.05, 0.3, 0.6])
def test_phase_steps_follow_the_second_whatever_the_read_out(upward: bool, idle: float) -> None:
    level, t = wandering(26.0, upward=upward, idle=idle)
    steps = track(level, t, method="phase")
    smeared = track(level, t, method="stft")
    assert len(steps) == 7
    assert max(abs(e.enf_hz - swing_hz(e.t_s)) for e in steps) < 0.4e-3
    assert max(abs(e.enf_hz - swing_hz(e.t_s)) for e in smeared) > 1.25e-3
    assert max(np.sqrt(e.enf_var_hz2) for e in steps) < 0.2e-3


def test_phase_steps_bear_lost_frames() -> None:
    level, t = wandering(26.0)
    keep = np.random.default_rng(8).uniform(size=t.size) > 0.03
    keep[0] = True
    number = np.flatnonzero(keep)
    blocks, at = [], 0
    for b in blocks_of(level[keep], t[keep]):
        blocks.append(dataclasses.replace(b, frame_number=number[at : at + b.frames]))
        at += b.frames
    estimates = feed(blocks, method="phase")
    assert len(estimates) == 7
    assert all(e.usable and abs(e.enf_hz - swing_hz(e.t_s)) < 1e-3 for e in estimates)


def test_phase_takes_longer_where_the_light_is_weak() -> None:
    spans = []
    for depth in (10.0, 0.8, 0.25):
        level, t = rows_of(50.02, seconds=21.0, depth=depth, noise=1.0)
        first = track(level, t, method="phase")[0]
        assert first.usable, first.reason
        spans.append(first.end_pts_ns - first.start_pts_ns)
    assert spans[0] < spans[1] < spans[2] <= 20 * 10**9


@pytest.mark.parametrize("method", METHODS)
def test_memory_is_bounded(method: str) -> None:
    stage = make_tracker(TrackSettings(method=method, nominal_hz=50.0))._method  # type: ignore[attr-defined]
    level, t = rows_of(50.0, seconds=90.0, rows=4)
    for block in blocks_of(level, t):
        stage.update(block)
    assert stage._buffer._value.shape[0] <= 2048  # the storage itself


def test_other_lines_are_not_theirs() -> None:
    for method in ("frame_mean", "superpixel", "row_concat"):
        with pytest.raises(UsageError, match="not line -2"):
            make_tracker(TrackSettings(method=method, line_m=-2))


def test_frames_missing_in_the_first_second_do_not_change_the_rate() -> None:
    level, t = rows_of(50.02, seconds=26.0)
    kept = (t < 0.3) | (t > 2.3)
    for estimate in track(level[kept], t[kept], method="row_concat")[2:]:
        assert estimate.usable, estimate.reason
        assert abs(estimate.enf_hz - 50.02) < 2e-4


def test_phase_steps_fit_into_a_short_window() -> None:
    level, t = rows_of(50.02, seconds=6.0)
    for window_s in (0.4, 3.5):
        assert track(level, t, method="phase", window_s=window_s, hop_s=window_s)
