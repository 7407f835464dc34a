"""Time stamps that jitter, of frames that a camera takes regularly."""

from __future__ import annotations

import numpy as np
import pytest

from rsenf.flicker.regular_clock import RegularClock
from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import Header, IdleEstimate, RowBlock
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.foreign_camera import film
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
