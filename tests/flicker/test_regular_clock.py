"""Time stamps that jitter, of frames that a camera takes regularly."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.flicker.regular_clock import RegularClock, RoundedClock
from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import Header, IdleEstimate, RowBlock
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.foreign_camera import Case, film
from tests.discrepancy.foreign_camera.trials import trial
from tests.flicker.foreign_rows import follow

JITTER_S, RATE_HZ = 4e-3, 30.0


def stamps(frames: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    number = np.arange(frames)
    off = JITTER_S * 3**0.5 * np.random.default_rng(seed).uniform(-1.0, 1.0, frames)
    return number, number / RATE_HZ + off


def test_the_rate_is_that_of_the_line_and_its_error_is_honest() -> None:
    z = []
    for seed in range(40):
        clock = RegularClock.fit(*stamps(600, seed))
        assert clock is not None
        z.append((clock.frame_rate_hz / RATE_HZ - 1.0) / clock.rate_ratio[1])
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.4


def test_even_stamps_lost_frames_and_rates_that_vary_make_no_clock() -> None:
    number, stamp_s = stamps(600)
    assert RegularClock.fit(number, number / RATE_HZ) is None
    assert RegularClock.fit(number, stamp_s + (number > 300) / RATE_HZ) is None
    assert RegularClock.fit(number, stamp_s + 0.05 * np.sin(number / 100.0)) is None


def test_blocks_get_even_times_over_a_gap_that_numbers_do_not_tell() -> None:
    number, stamp_s = stamps(900)
    clock = RegularClock.fit(number[:600], stamp_s[:600])
    assert clock is not None
    late_s = np.where(number >= 700, 3.0 / RATE_HZ, 0.0)
    made = []
    for first in range(600, 900, 25):
        own = slice(first, first + 25)
        pts_ns = np.rint(1e9 * (stamp_s + late_s)[own]).astype(np.int64)
        block = RowBlock(header=Header(), frames=25, frame_number=number[own], frame_pts_ns=pts_ns)
        made.append(clock.regular(block, 0).frame_pts_ns / 1e9)
    true_s = (number / RATE_HZ + late_s)[600:]
    assert np.abs(np.concatenate(made) - true_s).max() < 2e-3
    ratio, std = clock.rate_ratio
    assert abs(ratio * clock.frame_rate_hz / RATE_HZ - 1.0) < 4.0 * std < 1e-4


@pytest.mark.parametrize(
    ("rate", "nominal_hz", "seed"),
    [("60000/1001", 50.0, 34272), ("60", 50.0, 40047), ("30", 60.0, 40147), ("60.02", 50.0, 40097)],
)
def test_a_film_whose_stamps_jitter(rate: str, nominal_hz: float, seed: int) -> None:
    """Without the line there is nothing, or at 30 frames/s light on 60 Hz looks blended."""
    plan = trial("stamp jitter", seed, rate=rate, nominal_hz=nominal_hz, duration_s=40.0)
    made = follow(plan)
    assert made.off_hz.size > 30
    assert made.rms_z < 2.0
    filmed = film(plan)
    stage = make_idle(IdleSettings(method="coherent"))
    for block in blocks_from_luminance(filmed.level, filmed.stamp_s, Header()):
        stage.update(block)
    (said,) = [m for m in stage.flush() if isinstance(m, IdleEstimate)][-1:]
    assert said.verdict == "estimated"
    off = abs(said.idle_ratio - filmed.truth["idle_ratio"])
    assert off < 5.0 * said.idle_ratio_var**0.5 < 5e-3


@pytest.mark.parametrize(
    ("rate", "unit_s", "seed"),
    [("30", 1e-3, 61), ("60", 1e-3, 62), ("60000/1001", 1 / 600, 63), ("24000/1001", 1e-3, 64)],
)
def test_stamps_that_a_container_rounds_cost_nothing(rate: str, unit_s: float, seed: int) -> None:
    """Matroska rounds to 1 ms: at 30 frames/s this repeats every three, as light at 50 Hz does."""
    case = Case(seed=seed, rate=rate, nominal_hz=50.0, rows=64, strips=1, duration_s=60.0)
    exact, rounded = follow(case), follow(case, unit_s=unit_s)
    assert rounded.off_hz.size >= exact.off_hz.size - 1
    assert rounded.rms_z < 2.0
    assert np.std(rounded.off_hz) < 1.5 * np.std(exact.off_hz)


def test_rounded_stamps_with_frames_missing_and_a_rate_that_changes() -> None:
    """Missing frames don't move the line; where the rate changes, the stamps are kept."""
    true_s = np.delete(np.arange(900), [50, 51, 400]) / RATE_HZ
    true_s[800:] += 0.01 * np.arange(true_s.size - 800)
    stamp_s = np.rint(true_s * 1e3) / 1e3
    clock = RoundedClock.of_stamps(stamp_s[:600])
    assert clock is not None
    number = np.arange(true_s.size)
    assert np.abs(np.diff(clock.times(number, stamp_s)[:800] - true_s[:800])).max() < 1e-7
    pts_ns = np.rint(1e9 * stamp_s[600:]).astype(np.int64)
    block = RowBlock(
        header=Header(), frames=pts_ns.size, frame_number=number[600:], frame_pts_ns=pts_ns
    )
    even_s = clock.regular(block, 0).frame_pts_ns / 1e9
    assert np.abs(even_s - true_s[600:])[:200].max() < 5e-4
    assert np.abs(np.diff(even_s - stamp_s[600:])[205:]).max() < 1.1e-3


def test_rounded_stamps_of_a_clock_that_drifts_for_hours() -> None:
    """Ten parts in a million an hour: the line of the first frames is soon a frame away."""
    number = np.arange(30 * 3600 * 3)
    true_s = number / RATE_HZ * (1.0 + 5e-6 * number / RATE_HZ / 3600.0)
    stamp_s = np.rint(true_s * 1e3) / 1e3
    clock = RoundedClock.of_stamps(stamp_s[:600])
    assert clock is not None
    made = []
    for at in range(600, number.size - 300, 300):
        own = slice(at, at + 300)
        pts_ns = np.rint(1e9 * stamp_s[own]).astype(np.int64)
        block = RowBlock(header=Header(), frames=300, frame_number=number[own], frame_pts_ns=pts_ns)
        made.append(clock.regular(block, 0).frame_pts_ns / 1e9)
    gap_s = np.diff(np.concatenate(made))
    assert np.abs(gap_s - 1.0 / RATE_HZ).max() < 1e-5
    rate_hz = 1.0 / np.diff(true_s[-9000:]).mean()
    assert abs(clock.rate_ratio[0] * clock.frame_rate_hz / rate_hz - 1.0) < 3e-6


def test_what_is_not_rounded_makes_no_such_clock() -> None:
    number, stamp_s = stamps(600)
    assert RoundedClock.of_stamps(stamp_s) is None
    assert RoundedClock.of_stamps(number / RATE_HZ) is None
    shown = np.floor(number * 2.4) / 60.0  # 25 of 60 frames a second
    assert RoundedClock.of_stamps(shown) is None
    assert RoundedClock.of_stamps(np.rint((number + (number > 300)) ** 1.01 * 33.0) / 1e3) is None
