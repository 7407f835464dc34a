"""Bounds against maximum likelihood on simulated noise, and against plain counting."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rsenf.bench.measure import enf_bound_hz
from rsenf.bench.statistics import rate_bound
from rsenf.idle.coherent import idle_ratio_bound

Array = NDArray[np.float64]

LEVELS, SECOND_PHASE, NOISE = (2.0, 0.7), 0.9, 0.05
TRIALS = 500
# Three standard errors of a standard deviation from so many trials.
CLOSE = 3 / math.sqrt(2 * TRIALS)


def flicker(phase_rad: Array) -> Array:
    first, second = LEVELS
    return first * np.cos(phase_rad) + second * np.cos(2 * phase_rad + SECOND_PHASE)


def estimated_std(model: Callable[[Array], Array], true: Array, wanted: int) -> float:
    """Spread of one parameter's maximum-likelihood estimate, by Gauss and Newton from the truth."""
    rng, found = np.random.default_rng(3), []
    clean = model(true)
    for _ in range(TRIALS):
        seen = clean + rng.normal(0, NOISE, clean.size)
        guess = true.copy()
        for _ in range(3):
            steps = np.eye(true.size) * 1e-6
            slopes = np.stack([(model(guess + s) - model(guess - s)) / 2e-6 for s in steps], axis=1)
            guess += np.linalg.lstsq(slopes, seen - model(guess), rcond=None)[0]
        found.append(guess[wanted])
    return float(np.std(found))


def test_enf_bound_is_what_maximum_likelihood_reaches() -> None:
    rows, rate_hz, read_out_s, f0_hz = 24, 30.0, 0.02, 100.1
    t_s = (np.arange(30) / rate_hz)[:, None] + np.arange(rows) * (read_out_s / rows)
    centred = (t_s - 0.5).ravel()

    def model(p: Array) -> Array:
        return flicker(2 * np.pi * f0_hz * centred + p[0] * centred + p[1])

    std = estimated_std(model, np.array([0.0, 0.4]), 0) / (2 * np.pi) / 2
    bound = enf_bound_hz(
        noise_level=NOISE, amplitude_level=LEVELS, rows=rows, frame_rate_hz=rate_hz,
        read_out_time_s=read_out_s,
    )  # fmt: skip
    assert bound == pytest.approx(std, rel=CLOSE)


def test_idle_bound_is_what_maximum_likelihood_reaches() -> None:
    rows, frames, rate_hz, f0_hz, idle = 40, 7, 30.0, 100.0, 0.35
    down = np.arange(rows) / rows
    turn = 2 * np.pi * f0_hz * (1 - idle) / rate_hz
    true = np.concatenate(([turn], np.random.default_rng(1).uniform(0, 6, frames)))

    def model(p: Array) -> Array:
        return flicker(p[1:, None] + p[0] * down).ravel()

    std = estimated_std(model, true, 0) * rate_hz / (2 * np.pi * f0_hz)
    bound = idle_ratio_bound(
        noise_level=NOISE, amplitude_level=LEVELS, frames=frames, rows=rows,
        frame_rate_hz=rate_hz, f0_hz=f0_hz,
    )  # fmt: skip
    # The phases of a few frames average the information less well than those of a clip.
    assert bound == pytest.approx(std, rel=CLOSE + 0.05)


def test_without_flicker_nothing_is_known() -> None:
    bound = enf_bound_hz(
        noise_level=NOISE, amplitude_level=(0.0,), rows=720, frame_rate_hz=30.0,
        read_out_time_s=0.02,
    )  # fmt: skip
    assert bound == math.inf


@pytest.mark.parametrize(("events", "trials"), [(0, 200), (1, 200), (7, 40)])
def test_rate_bound_makes_so_few_events_one_in_twenty(events: int, trials: int) -> None:
    rate = rate_bound(events, trials)
    so_few = sum(
        math.comb(trials, k) * rate**k * (1 - rate) ** (trials - k) for k in range(events + 1)
    )
    assert so_few == pytest.approx(0.05)


def test_all_events_leave_every_rate_open() -> None:
    assert rate_bound(5, 5) == 1.0
