"""Centroid of the light in each strip: it decides what a lamp beside the camera makes of a wall.

Light that changes along the lines acts on a strip as it is at the strip's centre of brightness,
which is not its middle. So each half of a strip has a level of its own, found from training frames.

How far a strip leans as a whole, as it does towards the middle of a picture that is darker at its
ends, acts as if the light changed less along the lines. The rows don't tell these two apart: strips
are taken not to lean as a whole, and that they may belongs to the error of such a light.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from rsenf.discrepancy.forward_model import ForwardModel
from rsenf.discrepancy.measured import Float32Array, Measured

USUAL, MOST = 0.1, 0.5  # lean of a wall
STEP = 0.1


def leans(theory: ForwardModel) -> bool:
    """Whether there is light to which it matters."""
    strips = theory.wall.shape[1]
    return strips > 1 and any(effect.along_lines for effect in theory.model.effects)


def by_lean(theory: ForwardModel, rows: Float32Array, data: Measured) -> Float32Array:
    """What the rows do, per unit, when every strip leans more."""
    moved = dataclasses.replace(theory, lean=theory.lean + STEP).rows(data)
    return np.asarray((moved - rows) / np.float32(STEP))


def as_walls_may(direction: Float32Array) -> list[Float32Array]:
    """What the rows do when the wall's ends are darker, and when it is lit from one side.

    Both lean every strip as a whole, by :data:`USUAL` where most: (frames, lines, strips) each.
    """
    place = np.linspace(-1.0, 1.0, direction.shape[2], dtype=np.float32)
    return [direction * place, direction]


def leaned(
    theory: ForwardModel,
    left: Float32Array,
    direction: Float32Array,
    data: Measured,
    noise_var: float,
) -> tuple[ForwardModel, Float32Array]:
    """Let each line lean as the training frames have it, and walls usually do, less their mean.

    Parameters
    ----------
    theory : ForwardModel
    left : ndarray of float32 (frames, lines, strips)
        What it leaves of the data.
    direction : ndarray of float32 (frames, lines, strips)
        Of :func:`by_lean`.
    data : Measured
    noise_var : float
        Variance of a row's noise.

    Returns
    -------
    theory : ForwardModel
    left : ndarray of float32 (frames, lines, strips)
        What is left then.
    """
    own, seen = direction[data.training], left[data.training]
    own = own - own.mean(axis=0)  # all else the wall itself could do
    power = (own * own).sum(axis=0, dtype=np.float64) + noise_var / USUAL**2
    told = (own * seen).sum(axis=0, dtype=np.float64) - theory.lean * noise_var / USUAL**2
    lean = theory.lean + told / power
    lean = np.clip(lean - lean.mean(axis=0), -MOST, MOST)
    by = (lean - theory.lean).astype(np.float32)
    return dataclasses.replace(theory, lean=lean), left - by * direction
