"""Rows of a recording averaged into lines: as many as a fit needs.

What a fit costs is proportional to their number, and what it tells is not: the flicker turns some
ten times down a frame, and noise averages alike before a fit or in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import Float32Array

ENOUGH, FEWEST, FRAMES = 240, 120, 2000  # lines; and of how many frames there may be so many
FIELD_FRAMES, FIELD_STDS, FIELD_RATIO = 200, 6.0, 1e-3


def enough(frames: int) -> int:
    """How many lines are enough, that a long recording takes no more memory than it needs."""
    return min(max(ENOUGH * FRAMES // frames, FEWEST), ENOUGH)


def group_of(rows: int, most: int) -> int:
    """How many neighbouring rows to average, so that no more than so many lines are left.

    As many in each, for the lines must come regularly: a few rows at the end may be left over.
    """
    group = -(-rows // most)
    # A few lines less, if that leaves no row over.
    return next((n for n in range(group, 2 * group) if rows % n == 0), group)


def averaged(level: Float32Array, group: int) -> Float32Array:
    """Average so many neighbouring rows, (frames, rows, strips), into each line."""
    if group == 1:
        return level
    lines = level.shape[1] // group
    out = level[:, 0 : lines * group : group].copy()
    for n in range(1, group):
        out += level[:, n : lines * group : group]
    out *= np.float32(1.0 / group)
    return out


def along_rows(array: NDArray[Any], group: int, rows: int, axis: int = 1) -> NDArray[Any]:
    """Repeat the values of lines for the rows that were averaged, the last for what is left."""
    line = np.minimum(np.arange(rows) // group, array.shape[axis] - 1)
    return np.asarray(np.take(array, line, axis=axis))


def has_fields(level: Float32Array) -> bool:
    """Whether every second row is of another time, as fields woven into one picture are.

    Then what a row has beyond the mean of its neighbours comes again four rows further down, all
    over the picture. Texture doesn't, noise doesn't, and what is smooth has next to none.
    """
    seen = level[:: max(len(level) // FIELD_FRAMES, 1)]
    beyond = seen[:, 1:-1] - 0.5 * (seen[:, :-2] + seen[:, 2:])
    beyond -= beyond.mean(axis=0)
    alike = (beyond[:, 4:] * beyond[:, :-4]).mean(axis=(0, 2), dtype=np.float64)
    sure = alike.mean() / (alike.std() * np.sqrt(5.0 / alike.size) + 1e-30)
    return bool(sure > FIELD_STDS and alike.mean() > FIELD_RATIO * seen.var(axis=0).mean())
