"""Grids and clips with a known truth, for the matcher's tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsenf.bench.match_days import estimates_of
from rsenf.match.clip_phase import average, window_kernel
from rsenf.match.ncc import LagTable, lag_tables
from rsenf.match.series import Grid, Track
from rsenf.messages import Header, ReferenceBlock

WINDOW_S = 20.0
SMEAR_STD_HZ = 1.5e-3


def wandering_grid(seconds, seed, nominal_hz=50.0):
    """A grid's frequency at 1 s: a slow and a quick wander, each forgetting itself."""
    rng = np.random.default_rng(seed)
    out = np.full(seconds, nominal_hz)
    for std_hz, memory_s in ((18e-3, 400.0), (4e-3, 25.0)):
        keep = np.exp(-1 / memory_s)
        kicks = rng.standard_normal(seconds) * std_hz * np.sqrt(1 - keep**2)
        state = rng.standard_normal() * std_hz
        for i in range(seconds):
            state = keep * state + kicks[i]
            out[i] += state
    return out


def coloured_noise(count, std_hz, rng, window_s=WINDOW_S):
    """Estimation noise of overlapping Hann windows moved by 1 s: white noise under ``w·t``."""
    t_s = np.arange(-window_s / 2, window_s / 2 + 1)
    weights = np.cos(np.pi * t_s / window_s) ** 2 * t_s
    weights /= np.sqrt(weights @ weights)
    white = rng.standard_normal(count + t_s.size - 1)
    return std_hz * np.convolve(white, weights, "valid")


def clip_of(
    freq_hz, start_s, seconds, seed, *, std_hz=0.5e-3, ppm=0.0, nominal_hz=50.0, window_s=WINDOW_S
):
    """A track of a clip that began ``start_s`` after the first of 1 s samples.

    Estimates are the grid averaged as a Hann window does, at fractional places by linear
    interpolation, with coloured noise and a clock error. With a window of a second they are means
    of a second, each with its own variance only.
    """
    rng = np.random.default_rng(seed)
    count = round(seconds - window_s) + 1
    smooth = average(freq_hz, window_kernel(window_s, 1.0))
    centres_s = start_s + window_s / 2 + np.arange(count)
    enf = np.interp(centres_s - 0.5, np.arange(freq_hz.size), smooth)
    enf = enf + coloured_noise(count, std_hz, rng) - nominal_hz * ppm * 1e-6
    smear_std_hz = SMEAR_STD_HZ if window_s == WINDOW_S else 0.0
    variance = np.full(count, std_hz**2 + smear_std_hz**2)
    return Track(window_s / 2, 1.0, window_s, enf, variance, nominal_hz)


def grid_from(freq_hz, *, step_s=1.0, t0_ns=0, nominal_hz=50.0):
    return Grid("test", nominal_hz, t0_ns, step_s, np.asarray(freq_hz, float))


def estimates_from(track, *, epoch=0, seq=0):
    """The messages that would make this track."""
    header = Header(run_id="r", source="site/cam", epoch=epoch, seq=seq)
    return [replace(e, method="stft") for e in estimates_of(track, header)]


def blocks_from(grid, block=500):
    """The messages that would bring this reference."""
    total = grid.freq_hz.size
    return [
        ReferenceBlock(
            header=Header(source="reference/test", seq=seq),
            grid=grid.name,
            nominal_hz=grid.nominal_hz,
            t0_ns=grid.t0_ns,
            step_ns=round(grid.step_s * 1e9),
            first=first,
            samples=min(block, total - first),
            total=total,
            freq_hz=grid.freq_hz[first : first + block],
            readings=np.isfinite(grid.freq_hz[first : first + block]).astype(np.uint32),
        )
        for seq, first in enumerate(range(0, total, block))
    ]


def whole_table(x, x_ok, y, y_ok, *, min_pairs=3):
    """The matcher's table of all lags, joined from its stretches."""
    parts = list(lag_tables(x, x_ok, y, y_ok, min_pairs=min_pairs))
    names = ("pairs", "offset", "residual_var", "correlation")
    columns = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
    return LagTable(parts[0].first_lag, *columns)
