"""Finds the axis of a frame along which neighbours have independent noise: rows, or strips.

A sensor's noise is independent in each row. A codec quantises blocks of eight and more rows
together and removes fine detail, so that rows of one block share noise. Test: the difference of two
strips of a row, each relative to its mean, contains neither flicker nor the camera's gain, and its
third difference down the rows nothing smooth. For white noise the correlation of neighbouring third
differences is exactly −3/4; any other value means shared noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LINES, STRIPS = 1, 2  # axes of (frames, lines, strips)
TIMES = 3  # order of the differences
WHITE = -TIMES / (TIMES + 1.0)  # correlation of neighbouring differences of white noise
STDS = 5.0


def apart_of(level: NDArray[np.float32]) -> int:
    """Return the axis: ``LINES``, or ``STRIPS`` where rows share noise.

    Parameters
    ----------
    level : ndarray (frames, lines, strips)
        With one strip only the test isn't possible, and the axis is ``LINES``.
    """
    if level.shape[STRIPS] < 2:
        return LINES
    relative = level / np.maximum(level.mean(axis=0), 1e-6)
    pairs = level.shape[STRIPS] // 2
    difference = relative[:, :, 0 : 2 * pairs : 2] - relative[:, :, 1 : 2 * pairs : 2]
    # What differs between interlaced fields isn't noise; a codec's is shared within a field, too.
    return STRIPS if _is_shared(difference) and _is_shared(difference[:, ::2]) else LINES


def _is_shared(difference: NDArray[np.float32]) -> bool:
    """Whether the noise of neighbouring rows is correlated, positively or negatively."""
    steps = np.diff(difference, TIMES, axis=LINES)
    steps -= steps.mean(axis=0)
    power = float((steps * steps).mean(dtype=np.float64))
    if power == 0.0:
        return False
    shared = float((steps[:, 1:] * steps[:, :-1]).mean(dtype=np.float64)) / power - WHITE
    return bool(abs(shared) * steps.size**0.5 > STDS)
