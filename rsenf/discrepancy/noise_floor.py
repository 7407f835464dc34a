"""Noise floor: the distribution of the gap for data that the fitted model itself produced."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.gap import gap_of
from rsenf.discrepancy.measured import LINES, Float32Array, Measured
from rsenf.discrepancy.series import followed

SETS = 20
# A gap counts if it exceeds the median by so many standard deviations of the simulated gaps.
BEYOND_STDS = 4.0


@dataclass(frozen=True)
class NoiseFloor:
    """Gaps of simulated data sets without a discrepancy."""

    median: float
    limit: float  # smaller gaps are consistent with noise
    most: float  # the same for :attr:`rsenf.discrepancy.gap.Gap.most`

    def raised(self, gap: float, most: float) -> NoiseFloor:
        """Return the floor plus a codec's expected gap and its largest one."""
        return NoiseFloor(self.median + gap, self.limit + most, self.most + most)


def floor_of(fit: Fit, seed: int = 0, sets: int = SETS) -> NoiseFloor:
    """Simulate noise for a fit and return the gaps that remain after fitting it.

    A parametric bootstrap. Near the true parameters one linear step is a whole fit, so course,
    wall, parameters and series are fitted to each set of noise by one step.

    Parameters
    ----------
    fit : Fit
    seed : int, optional
        Of the noise.
    sets : int, optional
        Number of data sets.
    """
    rng, data = np.random.default_rng(seed), fit.data
    about, others = fit.slopes, ~data.training
    prior = np.zeros(about.basis.shape[1])
    knobs_from, course_from = (
        system.matrix.over(fit.noise_var).with_prior(prior).solver()
        for system in (about.training, about.course)
    )
    gaps = []
    for _ in range(sets):
        residual = _noise(fit, rng)
        step = knobs_from(about.training.normal(residual).over(fit.noise_var).vector)[prior.size :]
        for size, direction in zip(step.astype(np.float32), about.grads, strict=True):
            residual -= size * direction
        course = course_from(about.course.normal(residual).over(fit.noise_var).vector)
        residual -= (about.basis @ course).astype(np.float32)[:, None, None] * about.turn
        for effect in fit.theory.model.effects:
            series = series_of(effect)
            if series:
                direction = about.series[effect.name]
                _, residual = followed(direction, residual, about.lit, data, series[1])
        residual -= about.brighter(residual).astype(np.float32) * about.lit
        gaps.append(gap_of(residual, fit.flicker, data, others))
    values, combs = [gap.value for gap in gaps], [gap.comb for gap in gaps]
    limit = _limit(values)
    return NoiseFloor(float(np.median(values)), limit, max(limit, _limit(combs)))


def _limit(values: Sequence[float]) -> float:
    return float(np.median(values) + BEYOND_STDS * np.std(values, ddof=1))


def _noise(fit: Fit, rng: np.random.Generator) -> Float32Array:
    """Noise like the data's: white, or after a codec the strips' own noise, shifted in time."""
    data = fit.data
    if data.apart == LINES:
        noise_std = np.float32(np.sqrt(fit.noise_var))
        return noise_std * rng.standard_normal(fit.residual.shape, dtype=np.float32)
    unshared = _unshared(fit.residual, data)
    drawn = [unshared[:, :, rng.integers(unshared.shape[2])] for _ in range(data.strips)]
    return np.stack([np.roll(a, rng.integers(data.frames), axis=0) for a in drawn], axis=2)


def _unshared(residual: Float32Array, data: Measured) -> Float32Array:
    """Differences of strips, scaled to one strip's noise; from four strips on without gradient."""
    first, second = data.halves(residual)
    half_std = np.float32(np.sqrt(0.5))
    between: Float32Array = (first - second) * half_std
    fours = between.shape[2] // 2 * 2
    if fours:
        between = (between[:, :, :fours:2] - between[:, :, 1:fours:2]) * half_std
    return between
