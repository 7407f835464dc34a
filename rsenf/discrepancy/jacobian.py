"""Gauss-Newton steps: the Jacobian of the rows by finite differences, and the normal equations.

Each parameter's direction is its column of the Jacobian. The phase course has many directions, but
all are the derivative ``turn`` times a slow function of time, so that they need no columns of their
own. The wall, a free level of each line and strip, is eliminated exactly: the component that a
change of the wall could explain is projected out of every direction (Frisch, R. and Waugh, F. V.
(1933), Partial time regressions as compared with individual trends, Econometrica 1).
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from rsenf.discrepancy.fit_parameters import FitParameter, series_of
from rsenf.discrepancy.forward_model import ForwardModel, by_lean, leans, slope_of
from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.discrepancy.series import response
from rsenf.messages.schema import FloatArray

TINY = 1e-12
TURN_RAD, LIT = 0.02, 0.01


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations ``matrix @ x = vector``; the first ``course`` unknowns are the course's."""

    matrix: FloatArray
    vector: FloatArray
    course: int

    def over(self, variance: float) -> NormalEquations:
        """Divide by the noise variance of a line, which makes the matrix the Fisher information."""
        return NormalEquations(self.matrix / variance, self.vector / variance, self.course)

    def with_prior(self, weights: FloatArray) -> NormalEquations:
        """Add the course's prior, zero mean and unit variance, given its present weights."""
        matrix, vector = self.matrix.copy(), self.vector.copy()
        matrix.flat[: self.course * (len(matrix) + 1) : len(matrix) + 1] += 1.0
        vector[: self.course] -= weights
        return NormalEquations(matrix, vector, self.course)

    def solve(self) -> FloatArray:
        """Return the step; directions without information stay where they are."""
        return np.asarray(np.linalg.solve(*_scaled(self.matrix, self.vector)) * _scale(self.matrix))

    def solver(self) -> Callable[[FloatArray], FloatArray]:
        """Return a function that solves for any vector; the matrix is factorised once."""
        factors = lu_factor(_scaled(self.matrix, self.vector)[0])
        scale = _scale(self.matrix)
        return lambda vector: np.asarray(lu_solve(factors, vector * scale) * scale)

    def covariance(self) -> FloatArray:
        """Return the covariance of the step, the inverse of the matrix."""
        scale = _scale(self.matrix)
        inverse = np.linalg.inv(_scaled(self.matrix, self.vector)[0])
        return np.asarray(inverse * scale[:, None] * scale)

    def considering(self, last: int, std: float) -> FloatArray:
        """Return the covariance of a step without the last directions, which have unknown values.

        The consider covariance: Schmidt, S. F. (1966), Application of state-space methods to
        navigation problems, Advances in Control Systems 3.

        Parameters
        ----------
        last : int
            Number of these directions.
        std : float
            Standard deviation of their values.
        """
        known = len(self.matrix) - last
        step = NormalEquations(self.matrix[:known, :known], self.vector[:known], self.course)
        scale = _scale(step.matrix)
        taken, _ = _scaled(step.matrix, step.vector)
        for_it = np.linalg.solve(taken, self.matrix[:known, known:] * scale[:, None])
        shift = std * for_it * scale[:, None]
        return np.asarray(step.covariance() + shift @ shift.T)

    def sandwich(self, scores: FloatArray) -> FloatArray:
        """Return the cluster-robust covariance of the step.

        Liang, K.-Y. and Zeger, S. L. (1986), Longitudinal data analysis using generalized linear
        models, Biometrika 73; White, H. (1980), Econometrica 48.

        Parameters
        ----------
        scores : ndarray (clusters, directions)
            What each cluster of the data contributes to the vector.
        """
        away = scores - scores.mean(axis=0)
        apart = away.T @ away * (len(away) / (len(away) - 1))
        inverse = self.covariance()
        return np.asarray(inverse @ apart @ inverse)

    def explained(self, extra: int) -> float:
        """Reduction of the sum of squares by the last ``extra`` directions, beyond the others."""
        known = len(self.matrix) - extra
        matrix, vector = _scaled(self.matrix, self.vector)  # the result doesn't depend on scale
        rest = np.linalg.solve(matrix[:known, :known], np.column_stack(
            [matrix[:known, known:], vector[:known]]
        ))  # fmt: skip
        schur = matrix[known:, known:] - matrix[known:, :known] @ rest[:, :-1]
        reduced = vector[known:] - matrix[known:, :known] @ rest[:, -1]
        schur.flat[:: extra + 1] += TINY * np.trace(schur) + TINY
        return float(reduced @ np.linalg.solve(schur, reduced))

    def worth(self, members: Sequence[Hashable]) -> dict[Hashable, float]:
        """Wald statistic of groups of the last directions (Wald 1943): what each one explains.

        Parameters
        ----------
        members : sequence
            Group of each of the last directions.
        """
        step, covariance = self.solve()[-len(members) :], self.covariance()
        covariance = covariance[-len(members) :, -len(members) :]
        out: dict[Hashable, float] = {}
        for member in dict.fromkeys(members):
            at = [n for n, one in enumerate(members) if one == member]
            out[member] = float(step[at] @ np.linalg.solve(covariance[np.ix_(at, at)], step[at]))
        return out


class System:
    """Normal equations of a part of the data, for any number of residuals.

    Parameters
    ----------
    lit : ndarray (frames, lines, strips)
        Derivative of the rows by a relative change of the wall.
    turn : ndarray (frames, lines, strips)
        Derivative by the light's phase (1/rad).
    basis : ndarray (its frames, directions)
        The course's directions at each frame of the part.
    part : callable
        Selects the part from such an array.
    """

    def __init__(
        self,
        lit: Float32Array,
        turn: Float32Array,
        basis: FloatArray,
        part: Callable[[Float32Array], Float32Array],
    ) -> None:
        self._part, self._basis = part, basis
        self._lit, self._turn = self._taken(lit), self._taken(turn)
        square = (self._lit * self._lit).sum(axis=0, dtype=np.float64)
        self._size = 1.0 / np.sqrt(np.maximum(square, TINY))
        self._course = ((self._lit * self._turn).T @ basis) * self._size[:, None]
        power = _by_frame(self._turn, self._turn)
        self._matrix = basis.T @ (power[:, None] * basis) - self._course.T @ self._course
        self._others: list[tuple[Float32Array, FloatArray]] = []  # direction, projection on wall

    def plus(self, others: Sequence[Float32Array]) -> System:
        """Return the system with more directions, (frames, lines, strips) each."""
        out = copy.copy(self)
        out._others = [*self._others]
        for other in others:
            mine = self._taken(other)
            wall = self._wall(mine)
            out._others.append((other, wall))
            row = np.concatenate([self._along(mine, wall), out._beside(mine, wall)])
            out._matrix = np.block([[out._matrix, row[:-1, None]], [row[None, :]]])
        return out

    @property
    def matrix(self) -> NormalEquations:
        """Normal equations for a zero residual."""
        return NormalEquations(self._matrix, np.zeros(len(self._matrix)), self._basis.shape[1])

    def normal(self, residual: Float32Array) -> NormalEquations:
        """Return the normal equations for a residual (frames, lines, strips)."""
        rest = self._taken(residual)
        wall = self._wall(rest)
        vector = np.concatenate([self._along(rest, wall), self._beside(rest, wall)])
        return NormalEquations(self._matrix, vector, self._basis.shape[1])

    def scores(self, residual: Float32Array) -> tuple[FloatArray, FloatArray]:
        """What each frame, and each value of a frame, contributes to the vector.

        Parameters
        ----------
        residual : ndarray of float32 (frames, lines, strips)

        Returns
        -------
        by_frame : ndarray (its frames, directions)
        by_value : ndarray (lines · strips, directions)
        """
        rest = self._taken(residual)
        rest = rest - self._lit * (self._size * self._wall(rest)).astype(np.float32)
        turned, lit = self._turn * rest, self._lit * rest * self._size
        by_frame = [self._basis * turned.sum(axis=1)[:, None] - lit @ self._course]
        by_value = [turned.T @ self._basis]
        for other, projection in self._others:
            product = self._taken(other) * rest
            by_frame.append((product.sum(axis=1) - lit @ projection)[:, None])
            by_value.append(product.sum(axis=0)[:, None])
        return np.hstack(by_frame), np.hstack(by_value)

    def _taken(self, array: Float32Array) -> Float32Array:
        return np.ascontiguousarray(self._part(array)).reshape(len(self._basis), -1)

    def _wall(self, array: Float32Array) -> FloatArray:
        """Projection of an array on changes of the wall, for each line and strip."""
        return np.asarray((self._lit * array).sum(axis=0, dtype=np.float64) * self._size)

    def _along(self, array: Float32Array, wall: FloatArray) -> FloatArray:
        """Inner products with the course's directions, wall projected out."""
        product = _by_frame(self._turn, array)
        return np.asarray(self._basis.T @ product - self._course.T @ wall)

    def _beside(self, array: Float32Array, wall: FloatArray) -> list[float]:
        """Inner products with the other directions, wall projected out; makes no copies of them."""
        return [
            float(_by_frame(array, self._taken(other)).sum() - wall @ projection)
            for other, projection in self._others
        ]


def _by_frame(one: Float32Array, other: Float32Array) -> FloatArray:
    """Inner product of each frame's values. In float32 within a frame: 1e-9 off over a minute."""
    return np.asarray(np.vecdot(one, other), np.float64)


def _scale(matrix: FloatArray) -> FloatArray:
    return np.asarray(1.0 / np.sqrt(np.maximum(np.diag(matrix), TINY)))


def _scaled(matrix: FloatArray, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    scale = _scale(matrix)
    out = matrix * scale[:, None] * scale
    out.flat[:: len(out) + 1] += TINY
    return out, vector * scale


@dataclass(frozen=True, eq=False)
class Jacobian:
    """Derivatives of the rows at one forward model, (frames, lines, strips) each."""

    data: Measured
    # (frames, directions) phase per unit weight of the course's directions, in each frame
    basis: FloatArray
    lit: Float32Array  # by a relative change of the wall's level
    turn: Float32Array  # by the light's phase (1/rad)
    parameters: tuple[FitParameter, ...]
    grads: tuple[Float32Array, ...]  # by each of these parameters
    series: dict[str, Float32Array]  # by effect that has a series: by all of its values at once
    # by the strips' asymmetry; None if no light varies along the lines
    lean: Float32Array | None = None

    @cached_property
    def training(self) -> System:
        """Normal equations of course and parameters on the training frames."""
        frames = self.data.training
        return System(self.lit, self.turn, self.basis[frames], lambda a: a[frames]).plus(self.grads)

    @cached_property
    def course(self) -> System:
        """Normal equations of the course on the first half of every frame."""
        first = self.data.first  # the lambda must not hold self, whose arrays it would keep alive
        return System(self.lit, self.turn, self.basis, lambda a: a[first])

    def plus(self, parameters: Sequence[FitParameter], grads: Sequence[Float32Array]) -> Jacobian:
        """Return the Jacobian extended by more parameters and the derivatives by them."""
        out = dataclasses.replace(
            self, parameters=(*self.parameters, *parameters), grads=(*self.grads, *grads)
        )
        # Keep the cached normal equations.
        out.__dict__["training"] = self.training.plus(grads)
        out.__dict__["course"] = self.course
        return out

    def of_parameters(
        self, parameters: Sequence[FitParameter], forward: ForwardModel, rows: Float32Array
    ) -> Jacobian:
        """Return the Jacobian by parameters of a forward model near this one, with these rows."""
        known = dict(zip(self.parameters, self.grads, strict=True))
        kept = {one: grad for one, grad in known.items() if one in parameters}
        more = [one for one in parameters if one not in known]
        fewer = dataclasses.replace(self, parameters=tuple(kept), grads=tuple(kept.values()))
        grads = [by_parameter(forward, rows, self.data, one) for one in more]
        return (self if len(kept) == len(known) else fewer).plus(more, grads)

    def released(self) -> Jacobian:
        """Return it without its arrays, to free memory."""
        none = np.empty((0, 0, 0), np.float32)
        return dataclasses.replace(self, lit=none, turn=none, grads=(), series={}, lean=None)

    def brighter(self, residual: Float32Array) -> FloatArray:
        """Relative change of the wall by least squares on the training frames, (lines, strips)."""
        lit = self.lit[self.data.training]
        seen = (lit * residual[self.data.training]).sum(axis=0, dtype=np.float64)
        return np.asarray(seen / np.maximum((lit * lit).sum(axis=0, dtype=np.float64), TINY))


def jacobian_of(
    forward: ForwardModel,
    rows: Float32Array,
    data: Measured,
    parameters: Sequence[FitParameter] = (),
) -> Jacobian:
    """Compute the Jacobian of a forward model.

    Parameters
    ----------
    forward : ForwardModel
    rows : ndarray of float32 (frames, lines, strips)
        Its prediction.
    data : Measured
    parameters : sequence of FitParameter, optional
    """
    middle_s = data.time_s + 0.5 * forward.model.shutter.read_out_time_s
    series = {
        effect.name: response(forward, rows, data, effect, *found)
        for effect in forward.model.effects
        if (found := series_of(effect)) is not None
    }
    return Jacobian(
        data=data,
        basis=forward.course.basis_at(middle_s),
        lit=slope_of(forward.rows(data, lit=1.0 + LIT), rows, LIT),
        turn=slope_of(forward.rows(data, turned_rad=TURN_RAD), rows, TURN_RAD),
        parameters=tuple(parameters),
        grads=tuple(by_parameter(forward, rows, data, parameter) for parameter in parameters),
        series=series,
        lean=by_lean(forward, rows, data) if leans(forward) else None,
    )


def by_parameter(
    forward: ForwardModel, rows: Float32Array, data: Measured, parameter: FitParameter
) -> Float32Array:
    """Derivative of the rows by a fit parameter, (frames, lines, strips)."""
    moved = forward.with_model(parameter.moved(forward.model, parameter.step)).rows(data)
    return slope_of(moved, rows, parameter.step)
