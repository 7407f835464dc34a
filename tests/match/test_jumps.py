"""Jumps are left out; what a grid does is not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.match.series import _running_median, without_jumps
from tests.match.match_clips import clip_of, wandering_grid


@pytest.mark.parametrize("seed", range(3))
def test_running_median_is_the_plain_one(seed):
    rng = np.random.default_rng(seed)
    values = rng.standard_normal(60)
    values[rng.random(60) < 0.4] = np.nan
    values[20:40] = np.nan
    for i, median in enumerate(_running_median(values, 8)):
        near = values[max(i - 4, 0) : i + 5]
        near = near[np.isfinite(near)]
        assert median == (
            pytest.approx(np.median(near)) if near.size else pytest.approx(np.nan, nan_ok=True)
        )


def test_a_clean_clip_is_left_alone():
    freq = wandering_grid(3000, 5)
    freq[1500:] += 0.03 * np.clip((np.arange(1500) - 20) / 40, 0, 1)  # a plant trips
    track = clip_of(freq, 1000, 1200, 1, std_hz=1.5e-3)
    same, dropped = without_jumps(track)
    assert dropped == 0
    np.testing.assert_array_equal(same.enf_hz, track.enf_hz)


def test_jumps_become_holes():
    track = clip_of(wandering_grid(3000, 5), 1000, 300, 1)
    enf = track.enf_hz.copy()
    enf[[0, 50, 51, 52, 280]] += [0.2, -0.1, -0.1, 0.3, 0.05]
    enf[100:130] = np.nan
    clean, dropped = without_jumps(dataclasses.replace(track, enf_hz=enf))
    assert dropped == 5
    assert np.flatnonzero(np.isnan(clean.enf_hz)).tolist() == [0, 50, 51, 52, *range(100, 130), 280]


def test_nothing_usable_has_no_jumps():
    track = clip_of(wandering_grid(300, 5), 100, 50, 1)
    empty = dataclasses.replace(track, enf_hz=np.full(track.enf_hz.size, np.nan))
    assert without_jumps(empty)[1] == 0
