"""Heterogeneity: whether an effect has one size wherever it acts, or only a similar shape.

An effect of similar shape removes part of a discrepancy, here too much and there too little. The
residual then correlates with the effect's own response, by a size that differs between frames,
lines or parts of the recording. Other missing effects don't correlate with it. Compare Cochran, W.
G. (1954), The combination of estimates from different experiments, Biometrics 10.
"""

from __future__ import annotations

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.measured import BANDS, Float32Array
from rsenf.messages.schema import FloatArray

LEAST = 1e-12  # share of an effect's power that a part must have to determine a size
SURE = 4.0  # standard deviations of the noise, subtracted from the gain


def heterogeneity(fit: Fit, name: str) -> float:
    """Share of an effect's power gained beyond noise if every part of the data had its own size.

    Parts are: frames; lines of each strip; and bands of lines of each strip in each block of time.
    The partition with the largest gain counts. Each size is estimated from both of two neighbours,
    whose noise is independent, so that the product of the estimates is free of it.

    Parameters
    ----------
    fit : Fit
        With its arrays.
    name : str
        Of an effect of its model.

    Raises
    ------
    UsageError
        When the model without the effect isn't valid.
    """
    data, others = fit.data, ~fit.data.training
    without = fit.theory.with_model(fit.theory.model.without(name)).rows(data)
    residual = data.halves(fit.residual[others])
    does = data.halves((fit.rows - without)[others])
    moved = [residual_of * of for residual_of, of in zip(residual, does, strict=True)]
    power = [of * of for of in does]
    block = np.unique(data.block[others], return_inverse=True)[1]

    def by_frame(values: Float32Array) -> FloatArray:
        return np.asarray(values.sum(axis=(1, 2), dtype=np.float64))

    def by_line(values: Float32Array) -> FloatArray:
        return np.asarray(values.sum(axis=0, dtype=np.float64))

    def by_part(values: Float32Array) -> FloatArray:
        bands = np.array_split(values, min(BANDS, values.shape[1]), axis=1)
        banded = np.stack([band.sum(axis=1, dtype=np.float64) for band in bands], axis=1)
        out = np.zeros((block[-1] + 1, *banded.shape[1:]))
        np.add.at(out, block, banded)
        return out

    total = max(sum(float(of.sum(dtype=np.float64)) for of in power), 1e-30)
    most = 0.0
    for parts in (by_frame, by_line, by_part):
        (first, second), (one, other) = (list(map(parts, of)) for of in (moved, power))
        sized = (one > LEAST * total) & (other > LEAST * total)
        both = 1.0 / one[sized] + 1.0 / other[sized]
        gained = float((first[sized] * second[sized] * both).sum())
        noise = fit.noise_var * float(np.linalg.norm(np.sqrt(one[sized] * other[sized]) * both))
        most = max(most, (gained - SURE * noise) / total)
    return most
