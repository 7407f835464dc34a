"""Whether an effect has the same size wherever it acts, or only looks like what is there.

What is of a like shape takes away a part of a discrepancy, here too much and there too little. Then
what is left goes with what the effect does, with another size in each frame, line or part of the
recording: heterogeneity, as a meta-analysis of these parts would call it (Cochran 1954, "The
combination of estimates from different experiments", Biometrics 10). Other missing effects
have nothing to do with it.
"""

from __future__ import annotations

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.measured import BANDS, Float32Array
from rsenf.messages.schema import FloatArray

LEAST = 1e-12  # of what an effect does in all, that it must do in a part to have a size there
SURE = 4.0  # standard deviations of the noise


def heterogeneity(fit: Fit, name: str) -> float:
    """Share of an effect's power that it would surely gain if its size were free in every part.

    The parts are frames; lines of each strip; and bands of lines of each strip in each block of
    time. Those that differ most count. A size is found from each of two neighbours, whose noise has
    nothing to do with each other, so their product is free of it.

    Parameters
    ----------
    fit : Fit
        With its arrays.
    name : str
        Of an effect of its model.

    Raises
    ------
    UsageError
        When the model can't do without it.
    """
    data, others = fit.data, ~fit.data.training
    without = fit.theory.with_model(fit.theory.model.without(name)).rows(data)
    left = data.halves(fit.residual[others])
    does = data.halves((fit.rows - without)[others])
    moved = [left_of * of for left_of, of in zip(left, does, strict=True)]
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
