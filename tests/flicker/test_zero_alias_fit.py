"""The fit of flicker on texture against plain least squares with every unknown written out."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rsenf.flicker.zero_alias_fit import Flicker, Linearised, prior_precision, refine
from rsenf.flicker.zero_alias_rows import RowLogs

Float = NDArray[np.float64]
BINS, ROWS = 9, 17


def small(seed: int) -> tuple[RowLogs, Flicker]:
    """Return a small problem with uneven times and weights, and a point near its solution."""
    rng = np.random.default_rng(seed)
    t_s = np.cumsum(rng.uniform(0.2, 0.5, BINS))
    weight, row_weight = rng.uniform(0.5, 1.5, BINS), rng.uniform(0.5, 1.5, ROWS)
    place = (np.arange(ROWS) + 0.5) / ROWS
    flicker = Flicker(
        np.cumsum(0.3 * rng.standard_normal(BINS)),
        1.7,
        0.02,
        np.array([0.1, 0.02 - 0.01j]),
        np.array([0.3, -0.1]),
    )
    z = flicker.light(flicker.waves(t_s, place), place) + rng.standard_normal(ROWS)
    z += rng.standard_normal((BINS, 1)) + 0.01 * rng.standard_normal((BINS, ROWS))
    raw = RowLogs(z, t_s, weight / weight.mean(), row_weight / row_weight.mean(), place)
    data = RowLogs(raw.centred(z), t_s, raw.weight, raw.row_weight, place)
    return data, flicker


def numeric_slopes(data: RowLogs, flicker: Flicker) -> Float:
    """Derivatives of the light by (phases, q, τ, c, share), by differences: (bins·rows, unknowns).

    The rate that ``τ`` multiplies counts as known, as it does in the fit.
    """
    stretch = flicker.stretch(data.t_s, data.place)

    def light(step: Float) -> Float:
        moved = flicker.moved(step)
        angle = moved.phase_rad[:, None] + 2 * np.pi * moved.turns * data.place
        angle = angle + moved.read_out_s * stretch
        order = np.arange(1, moved.series.size + 1)
        waves = np.exp(1j * order[:, None, None] * angle)
        x = 2 * data.place - 1
        share = 1 + moved.share[0] * x + moved.share[1] * (2 * x * x - 1)
        return np.asarray((np.tensordot(moved.series, waves, 1).real * share).ravel(), np.float64)

    step = 1e-6 * np.eye(BINS + 7)
    return np.stack([(light(s) - light(-s)) / 2e-6 for s in step], axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_covariance_is_that_of_all_unknowns_together(seed: int) -> None:
    data, flicker = small(seed)
    point = Linearised(data, flicker)
    texture = np.tile(np.eye(ROWS), (BINS, 1))
    gain = np.repeat(np.eye(BINS), ROWS, axis=0)
    slopes = numeric_slopes(data, flicker)
    everything = np.concatenate([slopes, texture, gain], axis=1)
    weights = (data.weight[:, None] * data.row_weight).ravel()
    normal = everything.T @ (weights[:, None] * everything)
    count = slopes.shape[1]
    prior = prior_precision(data.t_s, flicker.unknowns)
    normal[:count, :count] += point.noise_var * prior
    expected = point.noise_var * np.linalg.pinv(normal, hermitian=True)[:count, :count]
    np.testing.assert_allclose(point.covariance(), expected, rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_the_end_is_a_minimum(seed: int) -> None:
    data, flicker = small(seed)
    end = refine(data, flicker, 50)
    prior = prior_precision(data.t_s, flicker.unknowns)
    cost = end.cost(end.noise_var, prior)
    rng = np.random.default_rng(seed)
    for _ in range(50):
        step = 1e-2 * rng.standard_normal(len(prior))
        step[BINS + 1] *= 0.1  # τ, in seconds
        assert Linearised(data, end.flicker.moved(step)).cost(end.noise_var, prior) > cost


def test_prior_knows_nothing_of_level_and_slope() -> None:
    t_s = np.cumsum(np.random.default_rng(0).uniform(0.2, 0.5, 30))
    prior = prior_precision(t_s, 33)
    line = np.zeros(len(prior))
    line[:30] = 3.0 - 0.2 * t_s
    np.testing.assert_allclose(prior @ line, 0.0, atol=1e-6)


def test_a_picture_that_never_changes_ends_the_fit_where_it_began() -> None:
    data, flicker = small(1)
    still = RowLogs(np.zeros_like(data.value), data.t_s, data.weight, data.row_weight, data.place)
    dark = Flicker(flicker.phase_rad, 1.7, 0.0, np.zeros(2, np.complex128), np.zeros(0))
    assert refine(still, dark, steps=3).flicker is dark
