"""Inlier selection: leaves out seconds of a clip whose phase no grid could have followed.

Motion or jumps of brightness produce phases that no grid frequency explains. They would make every
lag look wrong, and the alternative (any grid) too. The selection uses the clip alone, so it is the
same for all lags.

Statistic: for each block of 10 s, the log-likelihood ratio of a usual grid against no grid (both of
:mod:`rsenf.match.ou_likelihood`); a block is left out below ``-CLEAR``.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rsenf.match.clip_phase import ClipPhase
from rsenf.match.ou_likelihood import alone_log_likelihood, no_grid_log_likelihood
from rsenf.match.phase_filter import BLOCK_S

# Nats by which a block must be likelier under no grid than under a usual one, to be left out.
CLEAR = 6.0
LEAST = 10  # phases that must remain, or none is left out


@lru_cache(maxsize=4)
def inliers(clip: ClipPhase) -> NDArray[np.bool_]:
    """Return which phases may follow a grid; all of them if fewer than :data:`LEAST` would remain.

    Each block of :data:`BLOCK_S` is tested independently of its neighbours.
    """
    is_inlier = np.ones(clip.size, np.bool_)
    for first, last in stretches(clip):
        part = clip.between(first, last)
        if part.size > 1 and part.linked[1:].any():
            counted = part.linked[1:].astype(np.float64)
            shown = (alone_log_likelihood(part) - no_grid_log_likelihood(part))[1:] @ counted
            is_inlier[first:last] = shown >= -CLEAR
    return is_inlier if is_inlier.sum() >= LEAST else np.ones(clip.size, np.bool_)


def stretches(clip: ClipPhase) -> list[tuple[int, int]]:
    """Return the blocks of a clip as index ranges (first, first of the next)."""
    number = (clip.t_s - clip.t_s[0]) // BLOCK_S
    first = np.flatnonzero(np.diff(number, prepend=-1.0))
    return list(zip(first.tolist(), [*first[1:].tolist(), clip.size], strict=True))
