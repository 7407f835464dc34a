"""Rows of a recording averaged into lines: as many as a fit needs.

What a fit costs is proportional to their number, and what it tells is not: the flicker turns some
ten times down a frame, and noise averages alike before a fit or in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import Float32Array

ENOUGH, FEWEST, FRAMES = 120, 60, 2400  # lines; and of how many frames there may be so many
MOST, FAST = 240, 2.0  # lines for fast tones; power of one over the median of those as fast
DARK = 0.25  # of a line's level: darker rows count as if they had it
FIELD_FRAMES, FIELD_STDS, FIELD_RATIO, FIELD_ALIKE = 200, 6.0, 1e-3, 0.25


def enough(level: Float32Array) -> int:
    """How many lines are enough for rows (frames, rows, strips).

    Few of a long recording, that it takes no more memory than it needs; more where light changes so
    fast down the rows that it would seem to be slower in few lines (an alias).
    """
    lines = min(max(ENOUGH * FRAMES // len(level), FEWEST), ENOUGH)
    seen = level[:: max(len(level) // FIELD_FRAMES, 1)].mean(axis=2)
    seen = seen / np.maximum(seen.mean(axis=0), 1.0) - 1.0  # light, without the texture
    seen *= np.hanning(seen.shape[1]).astype(np.float32)
    power = (np.abs(np.fft.rfft(seen, axis=1)) ** 2).mean(axis=0)
    noise = float(np.median(power[power.size // 2 :]))
    # Two and a half lines a turn are the fewest that tell it well.
    while lines < MOST and power[2 * lines // 5 : MOST // 2].max(initial=0.0) > FAST * noise:
        lines *= 2
    return min(lines, MOST)


def group_of(rows: int, most: int) -> int:
    """How many neighbouring rows to average, so that no more than so many lines are left.

    As many in each, for the lines must come regularly: a few rows at the end may be left over.
    """
    group = -(-rows // most)
    # A few lines less, if that leaves no row over.
    return next((n for n in range(group, 2 * group) if rows % n == 0), group)


def averaged(level: Float32Array, group: int, fields: int = 1) -> Float32Array:
    """Average so many neighbouring rows, (frames, rows, strips), into each line.

    Of two fields that are woven into one picture, the lines are woven in the same way.
    """
    if group == 1:
        return level
    span = group * fields
    end = level.shape[1] // span * span
    out = np.empty((level.shape[0], end // group, level.shape[2]), np.float32)
    for field in range(fields):
        mean = out[:, field::fields]
        mean[:] = level[:, field:end:span]
        for row in range(field + fields, span, fields):
            mean += level[:, row:end:span]
    out *= np.float32(1.0 / group)
    return out


def along_rows(
    array: NDArray[Any], group: int, rows: int, *, fields: int = 1, axis: int = 1
) -> NDArray[Any]:
    """Repeat the values of lines for the rows that were averaged, the last for what is left."""
    row, last = np.arange(rows), array.shape[axis] // fields - 1
    line = np.minimum(row // fields // group, last) * fields + row % fields
    return np.asarray(np.take(array, line, axis=axis))


def texture_of(row_level: Float32Array, group: int, fields: int = 1) -> Float32Array:
    """Return the level of each row (rows, strips) over the mean of those that are averaged."""
    line = averaged(row_level[None], group, fields)[0]
    mean = along_rows(line, group, len(row_level), fields=fields, axis=0)
    return np.asarray(np.maximum(row_level, DARK * mean) / np.maximum(mean, 1e-6), np.float32)


def fields_of(level: Float32Array) -> int:
    """Return 2 where every second row is of another time, as fields woven into one picture are.

    What a row has beyond the mean of its neighbours then goes up and down from row to row, all over
    the picture. Texture doesn't change, noise has nothing to do with rows further on, what is
    smooth has next to none, and a fast tone has another period.
    """
    seen = level[:: max(len(level) // FIELD_FRAMES, 1)]
    beyond = seen[:, 1:-1] - 0.5 * (seen[:, :-2] + seen[:, 2:])
    beyond -= beyond.mean(axis=0)
    odd, even, next_odd = (
        (-1.0) ** lag * (beyond[:, lag:] * beyond[:, :-lag]).mean(axis=(0, 2), dtype=np.float64)
        for lag in (3, 4, 5)
    )
    sure = even.mean() / (even.std() * np.sqrt(5.0 / even.size) + 1e-30)
    beside = FIELD_ALIKE * even.mean()
    woven = (
        sure > FIELD_STDS
        and even.mean() > FIELD_RATIO * seen.var(axis=0).mean()
        and min(odd.mean(), next_odd.mean()) > beside
    )
    return 2 if woven else 1
