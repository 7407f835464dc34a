"""Along which axis of a frame neighbours' noise is their own: found from the noise itself.

A sensor's noise is every row's own. A codec rounds blocks of eight and more rows together and takes
their fine detail away, so that rows of one block share what is left of it. What two strips of a row
differ by, each over its mean, has neither flicker nor the camera's gain in it; differenced down the
rows nothing that is smooth either. Of white noise the differences of neighbouring rows are
correlated in a way that is known exactly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LINES, STRIPS = 1, 2  # axes of (frames, lines, strips)
TIMES = 3  # differenced so often
WHITE = -TIMES / (TIMES + 1.0)  # correlation of neighbours, of white noise
STDS = 5.0


def apart_of(level: NDArray[np.float32]) -> int:
    """Return the axis: ``LINES``, or ``STRIPS`` where rows share their noise.

    Parameters
    ----------
    level : ndarray (frames, lines, strips)
        Where there is but one strip it can't be told, and is ``LINES``.
    """
    if level.shape[STRIPS] < 2:
        return LINES
    relative = level / np.maximum(level.mean(axis=0), 1e-6)
    pairs = level.shape[STRIPS] // 2
    own = relative[:, :, 0 : 2 * pairs : 2] - relative[:, :, 1 : 2 * pairs : 2]
    # Fields that differ aren't noise: a codec's is in every second line too.
    return STRIPS if _is_shared(own) and _is_shared(own[:, ::2]) else LINES


def _is_shared(own: NDArray[np.float32]) -> bool:
    """Whether neighbouring rows have noise in common, or the opposite."""
    steps = np.diff(own, TIMES, axis=LINES)
    steps -= steps.mean(axis=0)
    power = float((steps * steps).mean(dtype=np.float64))
    if power == 0.0:
        return False
    shared = float((steps[:, 1:] * steps[:, :-1]).mean(dtype=np.float64)) / power - WHITE
    return bool(abs(shared) * steps.size**0.5 > STDS)
