"""Bins of a stream's rows: the plain means, in bounded room, however the frames come."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.idle.moments import MOST_BINS, RowBins

Float = NDArray[np.float64]


def stream(frames: int, step_s: float) -> tuple[Float, Float]:
    rng = np.random.default_rng(frames)
    kept = rng.random(frames) > 0.1
    t_s = np.asarray(3.0 + step_s * np.flatnonzero(kept), np.float64)
    return t_s, rng.uniform(50, 150, (int(kept.sum()), 5, 2))


def test_bins_are_means_of_their_frames() -> None:
    t_s, level = stream(100, 0.04)
    bins = RowBins(3.0)
    bins.add(t_s, level)
    mean, mean_t_s, frames = bins.means()
    which = ((t_s - 3.0) // 0.25).astype(int)
    for k, (rows, t, count) in enumerate(zip(mean, mean_t_s, frames, strict=True)):
        assert count == np.sum(which == k)
        np.testing.assert_allclose(rows, level[which == k].mean(axis=0))
        np.testing.assert_allclose(t, t_s[which == k].mean())


def test_long_streams_merge_and_lose_nothing() -> None:
    t_s, level = stream(5000, 0.04)
    t_s = np.where(np.arange(t_s.size) > 2000, t_s + 150.0, t_s)  # and a gap
    bins = RowBins(3.0)
    bins.add(t_s, level)
    mean, mean_t_s, frames = bins.means()
    assert bins.bin_s == 1.0
    assert len(mean) < MOST_BINS
    assert frames.sum() == t_s.size
    np.testing.assert_allclose(np.average(mean, axis=0, weights=frames), level.mean(axis=0))
    which = ((t_s - 3.0) // 1.0).astype(int)
    np.testing.assert_allclose(mean_t_s, [t_s[which == k].mean() for k in np.unique(which)])


def test_blocks_change_nothing() -> None:
    t_s, level = stream(1000, 0.3)
    whole, cut = RowBins(3.0), RowBins(3.0)
    whole.add(t_s, level)
    for part in np.array_split(np.arange(t_s.size), 37):
        cut.add(t_s[part], level[part])
    for a, b in zip(whole.means(), cut.means(), strict=True):
        np.testing.assert_array_equal(a, b)
