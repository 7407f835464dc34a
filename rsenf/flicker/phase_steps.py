"""Steps in a phase that should be smooth: the score test of a linear model with known noise.

Of data with a known covariance, that of the noise and that of a smooth course together, a step at
a place is best estimated by generalised least squares, and its square over its variance is twice
the logarithm of the likelihood ratio against no step (C. R. Rao, Proc. Camb. Phil. Soc. 44, 50,
1948). A course that wanders more than it is believed to makes steps out of nothing; so all is
taken relative to what is usual in the same stretch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

PARTS = 8  # of the time between points, at which a step may be
# Median of chi-squared with one degree of freedom.
USUAL = 0.455


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps at all places: before a part of each point.

    Attributes
    ----------
    size, std : ndarray, shape (points, PARTS)
        The step before the last ``k/PARTS`` of what a point is the mean of, and its standard error.
    """

    size: Float
    std: Float

    @property
    def log_ratio(self) -> Float:
        """Logarithm of the likelihood ratio against none, shape (points, PARTS)."""
        return np.asarray(0.5 * (self.size / self.std) ** 2)


def steps_in(told: Float, precision: Float) -> Steps:
    """Estimate the steps in a course.

    Parameters
    ----------
    told : ndarray, shape (points,)
    precision : ndarray, shape (points, points)
        Inverse of the covariance of noise and course together.
    """
    score = precision @ told
    after = np.triu(precision, 1)
    beside = after.sum(axis=1)
    later = _later(np.diag(precision) + 2.0 * beside)  # of all pairs of points that come later
    share = np.arange(PARTS) / PARTS
    top = _later(score)[:, None] + share * score[:, None]
    own = np.diag(precision)[:, None]
    heard = later[:, None] + 2.0 * share * beside[:, None] + share**2 * own
    heard = np.maximum(heard, max(1e-12 * heard.max(), 1e-300))
    usual = max(float(np.median(top[1:-1] ** 2 / heard[1:-1])) / USUAL, 1.0)
    return Steps(top / heard, np.sqrt(usual / heard))


def precision_of(information: Float, course: Float) -> Float:
    """Inverse covariance of independent noise and a course of independent directions.

    Parameters
    ----------
    information : ndarray, shape (points,) or (points, points)
        Inverse of the noise's covariance.
    course : ndarray, shape (points, directions)
        Each direction, of unit variance.
    """
    inverse = np.diag(information) if information.ndim == 1 else information
    heard = inverse @ course
    both = course.T @ heard
    both.flat[:: len(both) + 1] += 1.0
    return np.asarray(inverse - heard @ np.linalg.solve(both, heard.T))


def _later(values: Float) -> Float:
    """Sum of all values after each."""
    return np.asarray(np.cumsum(values[::-1])[::-1] - values)
