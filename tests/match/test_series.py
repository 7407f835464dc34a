"""Estimates and blocks on their uniform axes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.match.series import grid_of, phases, to_step_of, track_of
from tests.match.match_clips import (
    blocks_from,
    clip_of,
    estimates_from,
    grid_from,
    wandering_grid,
)


def test_track_keeps_holes_and_order():
    track = clip_of(wandering_grid(300, 1), 50.0, 100, 2)
    estimates = estimates_from(track)
    estimates[10] = dataclasses.replace(estimates[10], usable=False)
    del estimates[30:33]
    back = track_of(estimates[::-1])
    assert back.enf_hz.size == track.enf_hz.size
    assert np.flatnonzero(np.isnan(back.enf_hz)).tolist() == [10, 30, 31, 32]
    good = np.isfinite(back.enf_hz)
    np.testing.assert_array_equal(back.enf_hz[good], track.enf_hz[good])
    assert (back.first_s, back.hop_s, back.window_s) == (10.0, 1.0, 20.0)
    assert back.usable == track.enf_hz.size - 4


def test_grid_from_blocks_whatever_their_order():
    freq = wandering_grid(1300, 3)
    freq[200:700] = np.nan
    blocks = blocks_from(grid_from(freq, t0_ns=5))
    mixed = [blocks[2], blocks[0], blocks[1], blocks[0]]
    np.testing.assert_array_equal(grid_of(mixed).freq_hz, freq)
    assert np.isnan(grid_of([blocks[0], blocks[2]]).freq_hz[500:1000]).all()
    assert grid_of(blocks).t0_ns == 5


def test_a_finer_reference_is_averaged_over_what_is_valid():
    track = clip_of(wandering_grid(300, 1), 50.0, 100, 2)
    fine = 50 + np.arange(40) * 1e-3
    fine[12:16] = np.nan
    fine[20:26] = np.nan
    coarse = to_step_of(track, grid_from(fine, step_s=0.1))
    assert coarse.step_s == 1.0
    expected = [fine[:10].mean(), np.nanmean(fine[10:20]), np.nan, fine[30:40].mean()]
    np.testing.assert_allclose(coarse.freq_hz, expected, rtol=1e-15)


def test_a_coarser_reference_thins_the_track_at_every_phase():
    track = clip_of(wandering_grid(300, 1), 50.0, 100, 2)
    parts = list(phases(track, 2.0))
    assert [p.first_s for p in parts] == [10.0, 11.0]
    np.testing.assert_array_equal(parts[1].enf_hz, track.enf_hz[1::2])
    assert [p.first_s for p in phases(track, 1.0)] == [10.0]


def test_steps_that_do_not_fit_are_refused():
    track = clip_of(wandering_grid(300, 1), 50.0, 100, 2)
    with pytest.raises(UsageError, match="whole multiple"):
        to_step_of(track, grid_from(np.full(50, 50.0), step_s=1.5))
    with pytest.raises(UsageError, match="whole multiple"):
        to_step_of(track, grid_from(np.full(50, 50.0), step_s=0.3))
