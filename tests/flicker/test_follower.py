"""The follower of the flicker's phase: against truth, streamed in any blocks, with holes."""

from __future__ import annotations

import dataclasses
import itertools
from fractions import Fraction

import numpy as np
import pytest
from numpy.typing import NDArray

from rsenf.flicker.follower import FlickerFollower
from rsenf.flicker.second import FlickerSecond
from rsenf.messages import Header, RowBlock
from rsenf.model import CaptureModel, RowData, Shutter, simulate_rows, synthetic_grid
from rsenf.rows.stage import blocks_from_luminance
from tests.flicker import weak_lamps


def film(
    rate: str = "30000/1001", *, nominal_hz: float = 50.0, seconds: float = 45.0, seed: int = 1
) -> RowData:
    shutter = Shutter(frame_rate=Fraction(rate), rows=120, columns=160)
    grid = synthetic_grid(seed, seconds + 5, nominal_hz=nominal_hz)
    return simulate_rows(CaptureModel(shutter=shutter), grid, seconds, seed)


def follow(
    level: NDArray[np.float32], t: NDArray[np.float64], *, block_frames: int = 8, **options: float
) -> list[FlickerSecond]:
    follower = FlickerFollower(**options)
    blocks = blocks_from_luminance(level, t, Header(source="t/c"), block_frames=block_frames)
    return [*itertools.chain.from_iterable(map(follower.update, blocks)), *follower.flush()]


@pytest.fixture(scope="module")
def clip() -> RowData:
    return film()


@pytest.fixture(scope="module")
def seconds(clip: RowData) -> list[FlickerSecond]:
    return follow(clip.level, clip.frame_time_s)


def test_every_second_comes_once_in_order(seconds: list[FlickerSecond]) -> None:
    assert [s.index for s in seconds] == list(range(45))
    assert [(s.start_s, s.end_s) for s in seconds] == [(k, k + 1.0) for k in range(45)]
    assert all(s.usable and not s.reason and s.nominal_hz == 50.0 for s in seconds)
    frames = np.concatenate([s.frame_number for s in seconds])
    assert np.array_equal(frames, np.arange(frames.size))


def test_phase_is_the_lights(clip: RowData, seconds: list[FlickerSecond]) -> None:
    """The phase is the integral of the true frequency, up to a constant, at every frame."""
    number = np.concatenate([s.frame_number for s in seconds])
    phase = np.concatenate([s.phase_rad for s in seconds])
    true_cycles = synthetic_grid(1, 50.0).cycles(clip.frame_time_s[number])
    away = phase - 4 * np.pi * true_cycles
    assert np.std(away) < 2e-3
    assert np.max(np.abs(away - np.median(away))) < 1e-2


def test_turns_down_the_rows(seconds: list[FlickerSecond]) -> None:
    assert abs(seconds[-1].turns - 100.0 * 0.62 * 1001 / 30000) < 0.02


def test_amplitude_turns_with_the_phase(seconds: list[FlickerSecond]) -> None:
    carrier = 2 * np.pi * 100.0
    for s in seconds[5:-5]:
        t = s.frame_number * 1001 / 30000
        mid = np.polyval(np.polyfit(t - s.index - 0.5, s.phase_rad - carrier * t, 2), 0.0)
        assert abs(np.angle(s.amplitude * np.exp(-1j * mid))) < 3e-3
        assert abs(s.amplitude) > 100 * np.sqrt(s.amplitude_var)


@pytest.mark.parametrize("rate", ["30000/1001", "25"])
def test_how_blocks_are_cut_changes_no_bit(rate: str) -> None:
    clip = film(rate, seconds=34.0, seed=3)
    one = follow(clip.level, clip.frame_time_s)
    other = follow(clip.level, clip.frame_time_s, block_frames=61)
    assert len(one) == 34
    for a, b in zip(one, other, strict=True):
        for field in dataclasses.fields(FlickerSecond):
            assert np.array_equal(
                np.asarray(getattr(a, field.name)), np.asarray(getattr(b, field.name)),
                equal_nan=field.name not in ("reason", "usable", "frame_number"),
            ), field.name  # fmt: skip


def test_seconds_come_with_half_a_windows_delay(clip: RowData) -> None:
    follower = FlickerFollower()
    for block in blocks_from_luminance(clip.level, clip.frame_time_s, Header()):
        out = follower.update(block)
        now_s = block.frame_pts_ns[-1] / 1e9
        if now_s > 32.0:
            assert all(now_s - s.end_s < 16.0 for s in out)
    assert follower.flush()


def test_memory_is_bounded() -> None:
    clip = film(seconds=90.0, seed=4)
    follower = FlickerFollower()
    for block in blocks_from_luminance(clip.level, clip.frame_time_s, Header()):
        follower.update(block)
    assert follower._buffer._value.shape[0] <= 8192  # the storage itself
    assert follower._tracker is not None
    assert follower._tracker._path._psi.size < 300


def test_memory_without_a_signal_is_bounded() -> None:
    rng = np.random.default_rng(5)
    level = (100 + rng.normal(0, 1, (25 * 200, 16, 1))).astype(np.float32)
    follower = FlickerFollower()
    seen = 0
    for block in blocks_from_luminance(level, np.arange(len(level)) / 25.0, Header()):
        seen += len(follower.update(block))
    assert seen >= 139
    assert follower._buffer._value.shape[0] <= 8192
    assert follower._still is not None
    assert len(follower._still._sum) <= 500


def test_lost_frames_are_bridged_with_wider_errors() -> None:
    clip = film(seconds=60.5, seed=6)
    keep = (clip.frame_time_s < 28.2) | (clip.frame_time_s > 32.9)
    level, t = clip.level[keep], clip.frame_time_s[keep]
    truth = 2 * np.array(clip.truth["enf_hz"])
    out = follow(level, t, nominal_hz=50.0)
    assert [s.index for s in out] == list(range(60))
    assert all(s.usable for s in out if not 27 <= s.index <= 33)
    assert not any(s.usable for s in out[29:32])
    for s in out:
        if s.usable:
            assert abs(s.f0_hz - truth[s.index]) < max(4e-4, 5 * np.sqrt(s.f0_var_hz2))


@pytest.mark.parametrize("gap_s", [33, 120, 700])
def test_a_gap_longer_than_any_window_is_crossed(gap_s: int) -> None:
    clip = film(seconds=90.5, seed=8)
    t = clip.frame_time_s + np.where(clip.frame_time_s > 45.0, gap_s, 0)
    truth = 2 * np.array(clip.truth["enf_hz"])
    out = follow(clip.level, t, nominal_hz=50.0)
    assert [s.index for s in out] == list(range(90 + gap_s))
    assert not any(s.usable for s in out[46 : 44 + gap_s])
    assert all(s.usable for s in out[:30])
    assert all(s.usable for s in out[-20:])
    for s in out:
        if s.usable:
            at = s.index if s.index < 46 else s.index - gap_s
            assert abs(s.f0_hz - truth[at]) < max(1e-3, 5 * np.sqrt(s.f0_var_hz2))


def test_blocks_that_are_not_usable_do_not_count(clip: RowData) -> None:
    follower = FlickerFollower()
    out = []
    for block in blocks_from_luminance(clip.level, clip.frame_time_s, Header()):
        t = block.frame_pts_ns[0] / 1e9
        spoilt = np.full_like(block.level, 7.0)
        bad = dataclasses.replace(block, level=spoilt, usable=False)
        out += follower.update(bad if 20.0 < t < 22.0 else block)
    out += follower.flush()
    truth = 2 * synthetic_grid(1, 50.0).mean_hz(np.arange(45.0), np.arange(45.0) + 1)
    good = [s for s in out if s.usable]
    assert len(good) >= 40
    assert all(abs(s.f0_hz - truth[s.index]) < 5 * np.sqrt(s.f0_var_hz2) + 2e-4 for s in good)


def test_light_that_goes_out_is_noticed_and_found_again() -> None:
    clip = film(seconds=150.0, seed=7)
    rng = np.random.default_rng(7)
    dark = (clip.frame_time_s > 40.0) & (clip.frame_time_s < 100.0)
    clip.level[dark] = 100 + rng.normal(0, 0.3, clip.level[dark].shape)
    out = follow(clip.level, clip.frame_time_s)
    truth = 2 * np.array(clip.truth["enf_hz"])
    assert all(s.usable for s in out[:28])
    assert not any(s.usable for s in out[52:88])
    assert sum(s.usable for s in out[112:]) >= 30
    assert all(abs(s.f0_hz - truth[s.index]) < 2e-3 for s in out if s.usable and s.index > 110)


def test_short_and_empty_streams() -> None:
    assert FlickerFollower().flush() == []
    assert FlickerFollower().update(RowBlock(header=Header())) == []
    clip = film(seconds=2.0)
    out = follow(clip.level, clip.frame_time_s)
    assert len(out) == 2
    assert not any(s.usable for s in out)
    assert all(s.reason for s in out)


@pytest.mark.parametrize("rate", ["25", "50"])
def test_flicker_that_stands_still_is_not_claimed(rate: str) -> None:
    """At exactly the nominal frequency the phase doesn't turn: nothing can be told from texture."""
    shutter = Shutter(frame_rate=Fraction(rate), rows=120, columns=160)
    from rsenf.model import GridPath

    grid = GridPath(np.full(70, 50.0))
    clip = simulate_rows(CaptureModel(shutter=shutter), grid, 62.0, 8)
    out = follow(clip.level, clip.frame_time_s)
    assert len(out) == 62
    assert not any(s.usable for s in out)
    assert all(s.reason for s in out)


@pytest.mark.parametrize("seed", [0, 1, 4])
@pytest.mark.parametrize(("rate", "turned"), [("48", False), ("48000/1001", True)])
def test_beside_half_the_frame_rate_the_sign_is_that_of_the_read_out(
    seed: int, rate: str, turned: bool
) -> None:
    """The mirror image up the rows was taken: 18 to 41 mHz above 60 Hz instead of below."""
    level, t_s, truth = weak_lamps.film(seed, flicker_ratio=0.01, lamps=1, pace=(60.0, rate))
    level, t_s = level[: 30 * 48], t_s[: 30 * 48]
    followed = [s for s in follow(level[:, ::-1] if turned else level, t_s) if s.usable]
    assert len(followed) > 10
    off_hz = [s.f0_hz / 2.0 - truth["enf_hz"][s.index] for s in followed if s.index < 29]
    assert np.abs(off_hz).max() < 5e-3
