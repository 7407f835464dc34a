"""Who comes and goes leaves no steps: what stands there now, at the level of what stood before."""

from __future__ import annotations

import numpy as np

from rsenf.messages.schema import Float32Array

# In this many blocks an offset goes back to nothing, or nearly (1/e); and then it is nothing.
FADES_BLOCKS, NOTHING_LEVEL = 10.0, 0.01


class Levelling:
    """Offsets of tiles and rows, that fade slowly, with no step from frame to frame.

    Offsets, not factors: these would make dark parts' noise as bright as what stood there.
    """

    def __init__(self) -> None:
        self._offset: Float32Array | None = None  # (tiles, rows), at the end of the block before

    def replace(self, before: Float32Array, now: Float32Array) -> None:
        """Bring what has another background now to the level of before: both (tiles, rows)."""
        self._offset = (0.0 if self._offset is None else self._offset) + before - now

    def of_block(self, frames: int) -> Float32Array | None:
        """Return the next frames' offsets, (frames, tiles, rows); None where there are none."""
        offset = self._offset
        if offset is None:
            return None
        fade = np.exp(-np.arange(1, frames + 1, dtype=np.float32) / (frames * FADES_BLOCKS))
        self._offset = fade[-1] * offset if np.abs(offset).max() > NOTHING_LEVEL else None
        return np.asarray(fade[:, None, None] * offset)
