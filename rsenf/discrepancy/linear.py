"""The small linear problem of one step: what each direction explains of a residual.

A direction is what the rows do when a knob is turned, made by the capture model itself. The course
of the phase has many directions, but each is the same ``turn``, row by row, times a slow function
of time; and the wall, a level for each line and strip, is eliminated exactly: the part of every
direction that a change of the wall would do as well is taken off it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.measured import ALL, Float32Array, Mask, Part
from rsenf.messages.schema import FloatArray

TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations: ``matrix @ x = vector``, the course's directions first.

    ``course`` is how many of them are the course's.
    """

    matrix: FloatArray
    vector: FloatArray
    course: int

    def over(self, variance: float) -> Normal:
        """Weigh the data by the variance of a row's noise."""
        return Normal(self.matrix / variance, self.vector / variance, self.course)

    def with_prior(self, weights: FloatArray) -> Normal:
        """Add that the course's weights, now such, have unit variance."""
        matrix, vector = self.matrix.copy(), self.vector.copy()
        matrix.flat[: self.course * (len(matrix) + 1) : len(matrix) + 1] += 1.0
        vector[: self.course] -= weights
        return Normal(matrix, vector, self.course)

    def solve(self) -> FloatArray:
        """Return the step; directions that tell nothing stay where they are."""
        return np.asarray(np.linalg.solve(*_scaled(self.matrix, self.vector)) * _scale(self.matrix))

    def covariance(self) -> FloatArray:
        """Return the covariance of the step."""
        scale = _scale(self.matrix)
        inverse = np.linalg.inv(_scaled(self.matrix, self.vector)[0])
        return np.asarray(inverse * scale[:, None] * scale)

    def explained(self, extra: int) -> float:
        """By how much the last directions reduce the square of the residual, beyond the others."""
        known = len(self.matrix) - extra
        matrix, vector = self.matrix, self.vector
        rest = np.linalg.solve(matrix[:known, :known], np.column_stack(
            [matrix[:known, known:], vector[:known]]
        ))  # fmt: skip
        own = matrix[known:, known:] - matrix[known:, :known] @ rest[:, :-1]
        told = vector[known:] - matrix[known:, :known] @ rest[:, -1]
        own.flat[:: extra + 1] += TINY * np.trace(own) + TINY
        return float(told @ np.linalg.solve(own, told))


class Directions:
    """Directions of one theory, reduced to sums as they are needed.

    Parameters
    ----------
    lit : ndarray (frames, lines, strips)
        What the rows do when the wall is brighter, relative to it.
    turn : ndarray (frames, lines, strips)
        What they do when the light's phase is ahead, per rad.
    basis : ndarray (frames, directions)
        The course's directions at each frame.
    """

    def __init__(self, lit: Float32Array, turn: Float32Array, basis: FloatArray) -> None:
        self.lit, self.turn, self.basis = lit, turn, basis

    def normal(
        self,
        residual: Float32Array,
        others: Sequence[Float32Array],
        frames: Mask,
        part: Part = ALL,
    ) -> Normal:
        """Build the normal equations for some frames and a part of each."""
        lit, turn, rest, *own = (
            np.ascontiguousarray(a[frames][part]).reshape(int(frames.sum()), -1)
            for a in (self.lit, self.turn, residual, *others)
        )
        basis = self.basis[frames]
        size = 1.0 / np.sqrt(np.maximum((lit * lit).sum(axis=0, dtype=np.float64), TINY))
        course = ((lit * turn).T @ basis) * size[:, None]
        walls = [(lit * a).sum(axis=0, dtype=np.float64) * size for a in (rest, *own)]
        k, n = basis.shape[1], basis.shape[1] + len(own)
        matrix, vector = np.empty((n, n)), np.empty(n)
        power = (turn * turn).sum(axis=1, dtype=np.float64)
        matrix[:k, :k] = basis.T @ (power[:, None] * basis) - course.T @ course
        vector[:k] = basis.T @ (turn * rest).sum(axis=1, dtype=np.float64) - course.T @ walls[0]
        for a, (mine, wall) in enumerate(zip(own, walls[1:], strict=True)):
            along = basis.T @ (turn * mine).sum(axis=1, dtype=np.float64) - course.T @ wall
            matrix[k + a, :k] = matrix[:k, k + a] = along
            vector[k + a] = (mine * rest).sum(dtype=np.float64) - wall @ walls[0]
            for b in range(a + 1):
                both = (mine * own[b]).sum(dtype=np.float64) - wall @ walls[1 + b]
                matrix[k + a, k + b] = matrix[k + b, k + a] = both
        return Normal(matrix, vector, k)

    def brighter(self, residual: Float32Array, frames: Mask) -> FloatArray:
        """By how much the wall is brighter than it was, relative to it: (lines, strips)."""
        lit = self.lit[frames]
        seen = (lit * residual[frames]).sum(axis=0, dtype=np.float64)
        return np.asarray(seen / np.maximum((lit * lit).sum(axis=0, dtype=np.float64), TINY))


def _scale(matrix: FloatArray) -> FloatArray:
    return np.asarray(1.0 / np.sqrt(np.maximum(np.diag(matrix), TINY)))


def _scaled(matrix: FloatArray, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    scale = _scale(matrix)
    out = matrix * scale[:, None] * scale
    out.flat[:: len(out) + 1] += TINY
    return out, vector * scale
