"""Inliers: the seconds of a clip that may follow a grid; what no grid can have done tells nothing.

Where something moves, or the picture's brightness jumps, phases come out that no grid's frequency
can be behind. They would make every time look wrong, and any course whatever too. Which seconds
they are is told by the clip alone, so it is the same whatever time is looked at.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rsenf.match.clip_phase import ClipPhase
from rsenf.match.ou_likelihood import alone_log_likelihood, no_grid_log_likelihood
from rsenf.match.phase_filter import BLOCK_S

# Nats by which a few seconds must be likelier under no grid than under any, to be left out.
CLEAR = 6.0
LEAST = 10  # phases of a clip, below which none is left out


@lru_cache(maxsize=4)
def inliers(clip: ClipPhase) -> NDArray[np.bool_]:
    """Return which phases may follow a grid; all, where hardly any would be left.

    Each block of :data:`BLOCK_S` is looked at by itself: what is beside it has no say.
    """
    own = np.ones(clip.size, np.bool_)
    for first, last in stretches(clip):
        part = clip.between(first, last)
        if part.size > 1 and part.linked[1:].any():
            counted = part.linked[1:].astype(np.float64)
            shown = (alone_log_likelihood(part) - no_grid_log_likelihood(part))[1:] @ counted
            own[first:last] = shown >= -CLEAR
    return own if own.sum() >= LEAST else np.ones(clip.size, np.bool_)


def stretches(clip: ClipPhase) -> list[tuple[int, int]]:
    """Return the blocks of a clip, each from its first phase up to the next one's first."""
    number = (clip.t_s - clip.t_s[0]) // BLOCK_S
    first = np.flatnonzero(np.diff(number, prepend=-1.0))
    return list(zip(first.tolist(), [*first[1:].tolist(), clip.size], strict=True))
