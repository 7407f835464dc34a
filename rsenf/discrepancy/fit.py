"""Fits a forward model to a recording by Gauss-Newton steps, with the capture model's own Jacobian.

Model: rows are the forward model's rows plus white Gaussian noise of one variance; the phase course
has the Gaussian prior of :mod:`rsenf.flicker.grid_prior`.

Likelihood: Gaussian, so its maximum is that of least squares. Parameters of camera and lamp and the
wall are fitted to the training frames. The phase course, which is free at every moment, is fitted
to one half of each frame (every second line; after a codec every second strip). The other half of
the held-out frames is therefore independent of both, and judges the fit.

Approximate: in a step parameters, course, series and wall follow one after another, not jointly,
and remaining systematic errors are in the standard errors, but not in the weights of the data.

The noise floor is the distribution of the gap for data that the fitted model itself produced: what
is larger is a discrepancy.

References
----------
Nocedal, J. and Wright, S. J. (2006), Numerical Optimization: Gauss-Newton steps.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from typing import cast

import numpy as np

from rsenf.discrepancy.fit_parameters import FitParameter, parameters_of_model, series_of, turned
from rsenf.discrepancy.forward_model import ASYMMETRY_STD, ForwardModel, as_walls_may, leaned, leans
from rsenf.discrepancy.gap import Gap, gap_of
from rsenf.discrepancy.jacobian import Jacobian, jacobian_of
from rsenf.discrepancy.measured import BANDS, LINES, Float32Array, Measured
from rsenf.discrepancy.series import followed, improved
from rsenf.messages.schema import FloatArray

FARTHEST_RAD, FARTHEST_STEPS = 1.0, 50.0  # largest change in one step
# After a larger step (phase; parameter or series value, in its own steps) the Jacobian is renewed.
NEAR_RAD, NEAR_STEPS = 0.03, 1.0
# Convergence. A series follows the noise of its own frames, so that it needs no smaller steps.
REST_RAD, REST_STEPS, REST_SERIES = 1e-4, 1e-2, 0.1
MOST = 8
ASTRAY = 1.05  # mean square over the least of all steps, above which the fit has diverged

DARKEST = 0.01  # lowest level of the wall, whose changes are relative


@dataclass(frozen=True, eq=False)
class Fit:
    """A forward model fitted to data."""

    data: Measured
    begun: ForwardModel  # where the fit began
    forward: ForwardModel  # the fitted model
    rows: Float32Array  # (frames, lines, strips) its prediction, in 8-bit levels
    residual: Float32Array  # (frames, lines, strips) data minus prediction
    jacobian: Jacobian  # of the prediction
    stderr: FloatArray  # (parameters,) standard error of each parameter

    @property
    def parameters(self) -> tuple[FitParameter, ...]:
        """Fitted parameters, without phase course and wall."""
        return self.jacobian.parameters

    def released(self, *, rows: bool = False) -> Fit:
        """Return the fit without its arrays; with ``rows``, prediction and residual are kept."""
        out = dataclasses.replace(self, jacobian=self.jacobian.released())
        if not rows:
            none = np.empty((0, 0, 0), np.float32)
            out = dataclasses.replace(out, rows=none, residual=none)
        out.__dict__.update(gap=self.gap, misfit=self.misfit, noise_var=self.noise_var)
        return out

    def restored(self) -> Fit:
        """Return the fit with all arrays, computed again where they were released."""
        if self.jacobian.lit.size:
            return self
        rows = self.rows if self.rows.size else self.forward.rows(self.data)
        jacobian = jacobian_of(self.forward, rows, self.data, self.parameters)
        residual = self.data.level - rows
        return dataclasses.replace(self, rows=rows, residual=residual, jacobian=jacobian)

    def stderr_of(self, part: str) -> dict[str, float | list[float]]:
        """Standard errors of a part's parameters by name; a list for a parameter that is a list."""
        out: dict[str, float | list[float]] = {}
        for parameter, error in zip(self.parameters, self.stderr.tolist(), strict=True):
            if parameter.part != part or parameter.across:
                continue
            if parameter.index < 0:
                out[parameter.name] = error
            else:
                out[parameter.name] = [*cast("list[float]", out.get(parameter.name, [])), error]
        return out

    @cached_property
    def flicker(self) -> Float32Array:
        """Prediction minus the prediction without flicker, (frames, lines, strips)."""
        model = self.forward.model
        unlit = dataclasses.replace(model.light, flicker_ratio=0.0)
        still = self.forward.with_model(dataclasses.replace(model, light=unlit)).rows(self.data)
        return self.rows - still

    @cached_property
    def noise_var(self) -> float:
        """Variance of a line's noise in the training frames (levels²)."""
        return noise_var(self.residual[self.data.training], self.data)

    @cached_property
    def gap(self) -> Gap:
        """Gap of the held-out frames."""
        return gap_of(self.residual, self.flicker, self.data, ~self.data.training)

    @cached_property
    def misfit(self) -> float:
        """Mean square of the held-out frames' residual (levels²)."""
        return float((self.residual[~self.data.training] ** 2).mean(dtype=np.float64))


def fit(
    forward: ForwardModel, data: Measured, *, most: int = MOST, jacobian: Jacobian | None = None
) -> Fit:
    """Fit a forward model, its effects included, by Gauss-Newton (Nocedal and Wright 2006, ch. 10).

    Parameters
    ----------
    forward : ForwardModel
        Initial values. The phase may be off by half a turn, parameters by a half.
    data : Measured
    most : int, optional
        Maximum number of steps.
    jacobian : Jacobian, optional
        At the initial values, if known; saves its computation for the first step.
    """
    parameters = parameters_of_model(forward.model)
    begun, rows = forward, forward.rows(data)
    nearest = mean_square(data.level - rows), forward
    for _ in range(most):
        if jacobian is None:
            jacobian = jacobian_of(forward, rows, data, parameters)
        step = _stepped(forward, rows, jacobian)
        forward, rows = step.forward, step.rows
        nearest = min(nearest, (mean_square(data.level - rows), forward), key=itemgetter(0))
        complete = len(jacobian.parameters) == len(parameters) and (
            jacobian.lean is not None
        ) == leans(forward)
        if step.rested and complete:
            break
        if step.far or not complete:
            jacobian = None
    else:
        jacobian = jacobian or jacobian_of(forward, rows, data, parameters)
    residual = data.level - rows
    least, nearest_theory = nearest
    if mean_square(residual) > ASTRAY * least:  # diverged: back to the best step
        forward = nearest_theory
        rows = forward.rows(data)
        jacobian, residual = (
            jacobian_of(forward, rows, data, jacobian.parameters),
            data.level - rows,
        )
    return Fit(data, begun, forward, rows, residual, jacobian, _stderr(jacobian, residual))


def noise_var(residual: Float32Array, data: Measured) -> float:
    """Variance of a line's noise, from differences of neighbouring lines (strips after a codec).

    The least of the estimates by first differences at distances 1 and 2 and by second differences,
    so that neither a systematic alternation nor a slope of the residual counts as noise.
    """
    moved = np.moveaxis(residual, data.apart, 0)
    apart = [(moved[n:] - moved[:-n], 2.0) for n in (1, 2) if len(moved) > n]
    if len(moved) > 2:
        apart.append((moved[2:] - 2.0 * moved[1:-1] + moved[:-2], 6.0))
    return min(float(np.var(of, dtype=np.float64)) / times for of, times in apart)


def mean_square(residual: Float32Array) -> float:
    """Mean square of a residual (levels²)."""
    return float(np.vdot(residual, residual)) / residual.size


@dataclass(frozen=True, eq=False)
class _Step:
    """Result of a step: the new model and its rows, and the largest changes made."""

    forward: ForwardModel
    rows: Float32Array
    turned_rad: float
    turned_steps: float
    moved_steps: float  # of a series

    @property
    def far(self) -> bool:
        steps = self.turned_steps, self.moved_steps
        return self.turned_rad > NEAR_RAD or any(step > NEAR_STEPS for step in steps)

    @property
    def rested(self) -> bool:
        is_still = self.turned_rad < REST_RAD and self.turned_steps < REST_STEPS
        return is_still and self.moved_steps < REST_SERIES


def _stepped(forward: ForwardModel, rows: Float32Array, jacobian: Jacobian) -> _Step:
    """Take one step: parameters, then the course given these, then series, then the wall."""
    data, parameters = jacobian.data, jacobian.parameters
    residual = data.level - rows
    variance, weights = noise_var(residual[data.training], data), forward.course.weights
    normal = jacobian.training.normal(residual).over(variance).with_prior(weights)
    steps = np.array([abs(parameter.step) for parameter in parameters])
    step = np.clip(normal.solve()[normal.course :], -FARTHEST_STEPS * steps, FARTHEST_STEPS * steps)
    for size, direction in zip(step.astype(np.float32), jacobian.grads, strict=True):
        residual -= size * direction
    course = jacobian.course.normal(residual).over(variance).with_prior(weights).solve()
    farthest_rad = float(np.abs(jacobian.basis @ course).max())
    course *= min(1.0, FARTHEST_RAD / max(farthest_rad, 1e-9))
    residual -= (jacobian.basis @ course).astype(np.float32)[:, None, None] * jacobian.turn
    model = turned(forward.model, parameters, step.tolist())
    forward = dataclasses.replace(forward, model=model, course=forward.course.moved(course))
    forward, residual, moved_steps = improved(
        forward, residual, jacobian.lit, jacobian.series, data
    )
    if jacobian.lean is not None:
        forward, residual = leaned(forward, residual, jacobian.lean, data, variance)
    wall = np.clip(forward.wall * (1.0 + jacobian.brighter(residual)), DARKEST, 255.0)
    forward = dataclasses.replace(forward, wall=wall)
    turned_steps = float((np.abs(step) / steps).max())
    return _Step(forward, forward.rows(data), farthest_rad, turned_steps, moved_steps)


def _stderr(jacobian: Jacobian, residual: Float32Array) -> FloatArray:
    """Return the standard errors of the parameters, each the largest by several covariances."""
    data, system = jacobian.data, jacobian.training
    variance = noise_var(residual[data.training], data)
    normal = system.matrix.over(variance)
    normal = normal.with_prior(np.zeros(normal.course))
    found = [normal.covariance()]
    if jacobian.lean is not None:  # the centroids of strips are unknown
        may = as_walls_may(jacobian.lean)
        whole = system.plus(may).matrix.over(variance)
        found.append(whole.with_prior(np.zeros(whole.course)).considering(len(may), ASYMMETRY_STD))
    by_frame, by_value = system.scores(residual)  # includes what the model doesn't explain
    block = data.block[data.training]
    by_line = by_value.reshape(data.lines, data.strips, -1).sum(axis=1)
    for clusters in (
        [by_frame[block == number] for number in np.unique(block)],
        np.array_split(by_line, min(BANDS, data.lines)),
    ):
        if len(clusters) > 1:
            found.append(normal.sandwich(np.array([c.sum(axis=0) for c in clusters]) / variance))
    most = np.max([np.diag(covariance) for covariance in found], axis=0)
    return np.asarray(np.sqrt(np.maximum(most, 0.0))[normal.course :])


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
    about, others = fit.jacobian, ~data.training
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
        for effect in fit.forward.model.effects:
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
