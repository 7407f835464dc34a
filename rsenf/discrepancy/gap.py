"""The gap between a theory and the data: the systematic part of what is left, and its error.

Sensor noise of one row has nothing to do with that of the next. So the product of the residuals of
neighbouring rows is, on average, the square of what is systematically left, and no noise; over the
power of the flicker that was fitted it is the gap. Whatever follows the noise, such as the course
of the phase, must have been found from one of the two rows alone. A codec ties rows together; there
the neighbours are strips, each with columns of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.discrepancy.measured import Float32Array, Mask, Measured
from rsenf.messages.schema import FloatArray


@dataclass(frozen=True)
class Gap:
    """A gap.

    Attributes
    ----------
    value : float
        Power of the systematic residual over that of the flicker; its noise may make it negative.
    stderr : float
        Its standard error, by blocks of time.
    comb : float
        The same of the next but one among the neighbours that judge: what goes up and down from
        row to row has it, and may have none of the other.
    """

    value: float
    stderr: float
    comb: float

    @property
    def most(self) -> float:
        """The greater of both, of either sign: below zero neighbours are wrong by turns."""
        return max(abs(self.value), self.comb)


def products(residual: Float32Array, data: Measured) -> FloatArray:
    """Mean product of each frame's neighbours, (frames,)."""
    first, second = data.halves(residual)
    return np.asarray((first * second).mean(axis=(1, 2), dtype=np.float64))


def gap_of(residual: Float32Array, flicker: Float32Array, data: Measured, frames: Mask) -> Gap:
    """Return the gap over some frames.

    Parameters
    ----------
    residual, flicker : ndarray (frames, lines, strips)
        What is left, and what was fitted less the wall.
    data : Measured
    frames : ndarray of bool (frames,)
        Those that count.
    """
    power = float((flicker[frames] ** 2).mean(dtype=np.float64))
    gaps = by_block(products(residual, data), data, frames)[0] / power
    stderr = float(gaps.std(ddof=1) / math.sqrt(gaps.size)) if gaps.size > 1 else math.nan
    judges = np.moveaxis(residual[frames][data.second], data.apart, 0)
    further = float((judges[1:] * judges[:-1]).sum(dtype=np.float64))
    comb = further / max(judges[1:].size, 1) / power
    return Gap(float(gaps.mean()), stderr, comb)


def by_block(values: FloatArray, data: Measured, frames: Mask) -> tuple[FloatArray, FloatArray]:
    """Mean of a series of frames over each block of time, and how many frames that is.

    Blocks that are less than half there are left out.
    """
    return by_block_of(values[frames], data.block[frames])


def by_block_of(values: FloatArray, block: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Return the same of frames that all count, each in a block by its number."""
    count = np.bincount(block).astype(np.float64)
    total = np.bincount(block, weights=values)
    kept = count >= max(count.max() / 2.0, 1.0)
    return np.asarray(total[kept] / count[kept]), np.asarray(count[kept])
