"""Predicts the illumination's phase from a reference, by integrating its frequency.

A long reference on disk is read by pages, which are cached (least recently used dropped): a search
reads the same few hundred places again and again.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rsenf.match.clip_phase import RAD_PER_CYCLE
from rsenf.match.series import Grid
from rsenf.messages.schema import FloatArray

PAGE = 1 << 10  # samples
KEPT = 1 << 11  # pages, 16 MB
LONG = 1 << 18  # samples: longer slices are read past the cache
AT_ONCE = 64  # lags: more overflow the CPU cache
_BESIDE = 2  # extra samples at the clip's ends, for the slopes


class Pages:
    """Slices of a series, read page by page.

    Parameters
    ----------
    samples : array_like
        With ``size`` and slicing.
    """

    def __init__(self, samples: FloatArray) -> None:
        self.size, self._samples = samples.size, samples
        self.means = getattr(samples, "means", None)

        @lru_cache(maxsize=KEPT)
        def page(number: int) -> FloatArray:
            return np.asarray(samples[number * PAGE : (number + 1) * PAGE], np.float64)

        self._page = page

    def __getitem__(self, part: slice) -> FloatArray:
        """Return the samples from ``start`` up to ``stop``."""
        if part.stop - part.start > LONG:
            return np.asarray(self._samples[part], np.float64)
        numbers = range(part.start // PAGE, -(-part.stop // PAGE))
        first = numbers.start * PAGE
        whole = np.concatenate([self._page(number) for number in numbers])
        return whole[part.start - first : part.stop - first]


def in_pages(grid: Grid) -> Grid:
    """Return a reference with a page cache; one in memory is returned as it is."""
    if isinstance(grid.freq_hz, np.ndarray):
        return grid
    return replace(grid, freq_hz=cast("FloatArray", Pages(grid.freq_hz)))


def forecast(
    grid: Grid, lag_s: FloatArray, t_s: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Predict the phase of the illumination at the times of a clip, for given lags.

    A sample's mean frequency gives the phase step over the sample exactly; within it the frequency
    is a line with the slope between the two neighbouring samples.

    Parameters
    ----------
    grid : Grid
        Read in one slice for each lag.
    lag_s : ndarray, shape (c,)
        Clip's start less the reference's.
    t_s : ndarray, shape (n,)
        Times in the clip, rising.

    Returns
    -------
    phase_rad : ndarray, shape (n, c)
        Less that of twice the nominal frequency, up to a constant for each lag.
    known : ndarray of bool, shape (n, c)
        Whether the step from the time before lies within the reference and outside its gaps.
    """
    phase = np.empty((t_s.size, lag_s.size))
    known = np.zeros((t_s.size, lag_s.size), bool)
    # In rising order: a reference on disk is read fastest that way.
    order = np.argsort(lag_s)
    for i in range(0, order.size, AT_ONCE):
        some = order[i : i + AT_ONCE]
        phase[:, some], known[:, some] = _at_once(grid, lag_s[some], t_s)
    return phase, known


def _at_once(
    grid: Grid, lag_s: FloatArray, t_s: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    at = (lag_s + t_s[:, None]) / grid.step_s
    whole = np.floor(at)
    part = at - whole
    first = whole[0].astype(np.int64) - _BESIDE
    k = whole.astype(np.int64) - first
    width = int(k.max()) + 1 + _BESIDE
    # One row per lag: sums along rows are many times faster than down columns.
    away = _rows(grid, first, width) - grid.nominal_hz
    gap = np.isnan(away)
    has_gaps = gap.any()
    away[gap] = 0.0
    slope = np.zeros_like(away)
    slope[:, 1:-1] = (away[:, 2:] - away[:, :-2]) / 2.0
    if has_gaps:
        slope[:, 1:-1][gap[:, 2:] | gap[:, :-2]] = 0.0
    edge = away.cumsum(axis=1) - away
    here = k + width * np.arange(lag_s.size)  # index into the flattened rows
    cycles = slope.take(here) * ((part - 1.0) / 2.0)
    cycles += away.take(here)
    cycles *= part
    cycles += edge.take(here)
    known = np.ones(at.shape, bool)
    known[0] = False
    if has_gaps:
        missing = np.zeros((lag_s.size, width + 1), np.int64)
        np.cumsum(gap, axis=1, out=missing[:, 1:])
        here += np.arange(lag_s.size)
        end = here + (part > 0.0)
        known[1:] = missing.take(end[1:]) == missing.take(here[:-1])
    return RAD_PER_CYCLE * grid.step_s * cycles, known


def _rows(grid: Grid, first: NDArray[np.int64], width: int) -> FloatArray:
    """Return ``width`` samples from each place, shape (places, width)."""
    begin, end = int(first[0]), int(first[-1]) + width
    if end - begin > first.size * width:
        return np.stack([samples(grid, f, f + width) for f in first.tolist()])
    row = samples(grid, begin, end)
    # Made by hand: sliding_window_view would take a third of the time of a live clip's forecast.
    every = np.ndarray((row.size - width + 1, width), row.dtype, row, strides=2 * row.strides)
    return every[first - begin]


def samples(grid: Grid, start: int, stop: int) -> FloatArray:
    """Return a range of a reference's samples, NaN beyond its ends."""
    out = np.full(stop - start, np.nan)
    a, b = max(start, 0), min(stop, grid.freq_hz.size)
    if a < b:
        out[a - start : b - start] = grid.freq_hz[a:b]
    return out
