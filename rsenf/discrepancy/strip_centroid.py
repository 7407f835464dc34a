"""Centroid of the light within each strip, which matters if the light varies along the lines.

A lamp to one side gives light that varies along the lines. A strip sees it as at its centroid of
brightness, not at its middle. So each half of a strip has its own level, fitted to training frames
with a prior of standard deviation :data:`USUAL`.

A shift of the centroid that is common to all lines of a strip, as by vignetting, can't be told from
a weaker gradient of the light. It is fixed at zero, and its uncertainty enters the standard errors
(:func:`as_walls_may`).
"""

from __future__ import annotations

import dataclasses

import numpy as np

from rsenf.discrepancy.forward_model import ForwardModel
from rsenf.discrepancy.measured import Float32Array, Measured

USUAL, MOST = 0.1, 0.5  # asymmetry of a strip: standard deviation, maximum
STEP = 0.1


def leans(theory: ForwardModel) -> bool:
    """Whether the model has light that varies along the lines."""
    strips = theory.wall.shape[1]
    return strips > 1 and any(effect.along_lines for effect in theory.model.effects)


def by_lean(theory: ForwardModel, rows: Float32Array, data: Measured) -> Float32Array:
    """Derivative of the rows by a common asymmetry of all strips, (frames, lines, strips)."""
    moved = dataclasses.replace(theory, lean=theory.lean + STEP).rows(data)
    return np.asarray((moved - rows) / np.float32(STEP))


def as_walls_may(direction: Float32Array) -> list[Float32Array]:
    """Derivatives of the rows by vignetting, and by a brightness gradient along the lines.

    Both shift the centroids of whole strips: (frames, lines, strips) each, per unit of asymmetry.
    """
    place = np.linspace(-1.0, 1.0, direction.shape[2], dtype=np.float32)
    return [direction * place, direction]


def leaned(
    theory: ForwardModel,
    residual: Float32Array,
    direction: Float32Array,
    data: Measured,
    noise_var: float,
) -> tuple[ForwardModel, Float32Array]:
    """Fit the asymmetry of each line's strips to the training frames; its mean over lines is zero.

    Parameters
    ----------
    theory : ForwardModel
    residual, direction : ndarray of float32 (frames, lines, strips)
        Residual, and result of :func:`by_lean`.
    data : Measured
    noise_var : float
        Variance of a line's noise.

    Returns
    -------
    theory : ForwardModel
    residual : ndarray of float32 (frames, lines, strips)
        Residual after the step, to first order.
    """
    centred, target = direction[data.training], residual[data.training]
    centred = centred - centred.mean(axis=0)  # the mean is explained by the wall
    power = (centred * centred).sum(axis=0, dtype=np.float64) + noise_var / USUAL**2
    product = (centred * target).sum(axis=0, dtype=np.float64) - theory.lean * noise_var / USUAL**2
    lean = theory.lean + product / power
    lean = np.clip(lean - lean.mean(axis=0), -MOST, MOST)
    by = (lean - theory.lean).astype(np.float32)
    return dataclasses.replace(theory, lean=lean), residual - by * direction
