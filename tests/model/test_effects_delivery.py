"""Effects on which frames arrive, and on their stamps."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest

from rsenf.model import render_frames
from tests.model.bare import (
    F0_HZ,
    LEVEL,
    RATE_HZ,
    STEADY,
    bare,
    film,
    frame_tones,
    line_times_s,
    phase_error_rad,
    wave,
)

STEP_RAD = 2 * np.pi * F0_HZ / RATE_HZ  # of the alias, from frame to frame


def steps_rad(data: object) -> np.ndarray:
    """Change of the flicker's phase, against the stamps, from frame to frame."""
    tones = frame_tones(data, line_times_s(data.frame_time_s))
    return phase_error_rad(tones[1:] * np.conj(tones[:-1]) * np.exp(1j * 0.4))


def plain_rows(number: np.ndarray) -> np.ndarray:
    return LEVEL * wave(line_times_s(number / RATE_HZ))


@pytest.mark.parametrize("retimed", [False, True])
def test_dropped_frames_leave_a_hole_or_a_step(retimed: bool) -> None:
    data = film(bare().with_effect("frame_drop", drops_per_min=120.0, retimed=retimed), seed=3)
    dropped = data.truth["dropped_frames"]
    assert len(dropped) == pytest.approx(20, abs=12)
    kept = np.setdiff1d(np.arange(300), dropped)
    assert data.truth["frames"] == len(data.level) == len(kept)
    assert data.level[:, :, 0] == pytest.approx(plain_rows(kept), abs=0.15)
    stamps = np.arange(len(kept)) if retimed else kept
    assert data.frame_time_s == pytest.approx(stamps / RATE_HZ, abs=1e-12)
    lost = np.diff(kept) - 1  # between each frame and the next
    expected = lost * STEP_RAD if retimed else 0 * lost
    assert np.exp(1j * steps_rad(data)) == pytest.approx(np.exp(1j * expected), abs=5e-3)


def test_how_often_frames_are_dropped() -> None:
    data = film(bare(rows=16, columns=16).with_effect("frame_drop", drops_per_min=60.0), 600.0)
    count = len(data.truth["dropped_frames"])
    assert count == pytest.approx(600, abs=5 * np.sqrt(600))


@pytest.mark.parametrize("retimed", [False, True])
def test_duplicated_frames_are_the_same_twice(retimed: bool) -> None:
    model = bare().with_effect("frame_duplicate", at_frames=[40, 41, 200, 299], retimed=retimed)
    data = film(model)
    number: list[int] = []
    for n in range(300):  # written out, frame by frame
        if retimed:
            number += [n, n] if n in (40, 41, 200, 299) else [n]
        else:
            number.append({41: 40, 42: 41, 201: 200}.get(n, n))
    assert data.truth["frames"] == len(number)
    assert data.level[:, :, 0] == pytest.approx(plain_rows(np.array(number)), abs=0.15)
    assert data.frame_time_s == pytest.approx(np.arange(len(number)) / RATE_HZ, abs=1e-12)
    for n, (a, b) in enumerate(itertools.pairwise(number)):
        assert np.array_equal(data.level[n], data.level[n + 1]) == (a == b)
    expected = (np.diff(number) - 1) * STEP_RAD
    assert np.exp(1j * steps_rad(data)) == pytest.approx(np.exp(1j * expected), abs=5e-3)


def test_duplicated_pictures_are_the_same_to_the_last_bit() -> None:
    model = bare(rows=32, columns=32).with_effect("frame_duplicate", at_frames=[5, 63, 64])
    planes = [y.copy() for _, y in render_frames(model, STEADY, 3.0, 1)]
    same = [n for n in range(len(planes) - 1) if np.array_equal(planes[n], planes[n + 1])]
    assert same == [5, 64, 66]


def test_a_drop_and_a_duplicate_make_up_for_each_other() -> None:
    model = bare().with_effect("frame_drop", at_frames=[100])
    data = film(model.with_effect("frame_duplicate", at_frames=[200]))
    assert data.truth["frames"] == 300
    assert (data.truth["dropped_frames"], data.truth["duplicated_frames"]) == ([100], [200])
    steps = steps_rad(data)
    where = np.flatnonzero(np.abs(steps) > 0.1)
    assert where.tolist() == [99, 199]
    assert steps[where[0]] == pytest.approx(-steps[where[1]], abs=5e-3)


@pytest.mark.parametrize("to_rate", ["25", "60", "30"])
def test_a_converted_rate_shows_the_last_frame_that_rounds_to_it(to_rate: str) -> None:
    data = film(bare().with_effect("rate_conversion", to_rate=Fraction(to_rate)))
    ticks = np.arange(300) * Fraction(to_rate) * Fraction(1001, 30000)
    shown: dict[int, int] = {}
    for n, tick in enumerate(ticks):  # a later frame takes the place of an earlier one
        shown[math.floor(tick + Fraction(1, 2))] = n
    number = np.array([
        max(n for tick, n in shown.items() if tick <= k) for k in range(len(data.level))
    ])  # fmt: skip
    assert len(data.level) == math.floor(ticks[-1]) + 1
    assert data.frame_time_s == pytest.approx(np.arange(number.size) / float(to_rate), abs=1e-12)
    assert data.level[:, :, 0] == pytest.approx(plain_rows(number), abs=0.15)
    assert data.truth["frame_start_s"] == pytest.approx(number / RATE_HZ, abs=1e-12)


@pytest.mark.parametrize("to_rate", ["25", "60"])
def test_a_converted_rate_blends_the_frames_about_it(to_rate: str) -> None:
    model = bare().with_effect("rate_conversion", to_rate=Fraction(to_rate), way="blend")
    data = film(model)
    at = np.arange(len(data.level)) / float(to_rate) * RATE_HZ  # captured frames
    before = np.floor(at + 1e-9)
    share = (at - before)[:, None]
    expected = (1 - share) * plain_rows(before) + share * plain_rows(before + 1)
    assert data.level[:, :, 0] == pytest.approx(expected, abs=0.15)


def test_stamps_jitter_and_frames_don_t() -> None:
    plain, jittered = film(bare(), 60.0), film(bare().with_effect("timestamp_jitter"), 60.0)
    assert np.array_equal(plain.level, jittered.level)
    error_s = jittered.frame_time_s - plain.frame_time_s
    assert error_s[0] == 0
    assert np.std(error_s) == pytest.approx(1e-3, rel=0.06)
    assert np.all(np.diff(jittered.frame_time_s) > 0)
    seen = phase_error_rad(frame_tones(jittered, line_times_s(jittered.frame_time_s)))
    believed = np.exp(-2j * np.pi * F0_HZ * error_s)
    assert np.exp(1j * seen) == pytest.approx(believed, abs=5e-3)
    assert jittered.truth["frame_start_s"] is None


def test_wild_stamps_never_run_backwards() -> None:
    data = film(bare(rows=16).with_effect("timestamp_jitter", jitter_s=0.02), 60.0)
    assert np.all(np.diff(data.frame_time_s) > 0)
