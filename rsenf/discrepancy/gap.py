"""The gap: power of the systematic residual relative to the flicker's, free of noise.

Model: the residual of a line is a systematic part, which neighbouring lines share, plus sensor
noise, which is independent. The mean product of neighbours' residuals is then an unbiased estimate
of the systematic part's power::

    gap = ⟨r_even · r_odd⟩ / ⟨y²⟩,    y: fitted flicker without the static level

All that follows the noise, such as the phase course, must have been fitted to one of the two only.
A codec correlates the noise of rows, but not of strips, so after a codec neighbours are strips. The
standard error is that of the means over blocks of time.
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
    """A gap."""

    value: float  # power of the systematic residual over the flicker's; noise may make it negative
    stderr: float  # standard error, from blocks of time
    # the same from judging lines next to each other, two lines apart: reveals a residual that
    # alternates from line to line, which the gap can miss
    comb: float

    @property
    def most(self) -> float:
        """The larger magnitude of both; below zero, neighbours err in opposite ways."""
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
        Data minus prediction, and prediction minus wall.
    data : Measured
    frames : ndarray of bool (frames,)
        Which frames count.
    """
    power = float((flicker[frames] ** 2).mean(dtype=np.float64))
    gaps = by_block(products(residual, data)[frames], data.block[frames])[0] / power
    stderr = float(gaps.std(ddof=1) / math.sqrt(gaps.size)) if gaps.size > 1 else math.nan
    judges = np.moveaxis(residual[frames][data.second], data.apart, 0)
    further = float((judges[1:] * judges[:-1]).sum(dtype=np.float64))
    comb = further / max(judges[1:].size, 1) / power
    return Gap(float(gaps.mean()), stderr, comb)


def by_block(values: FloatArray, block: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Mean of a series over the frames of each block of time, and their number.

    Blocks with less than half of the most frames are left out.
    """
    count = np.bincount(block).astype(np.float64)
    total = np.bincount(block, weights=values)
    kept = count >= max(count.max() / 2.0, 1.0)
    return np.asarray(total[kept] / count[kept]), np.asarray(count[kept])
