"""Pixel noise at video rate, from a bank of normal random numbers.

Drawing a million normal numbers a frame would take ten times longer than everything else. So the
noise of a row is a section of a long bank at a random position, drawn anew for every row of every
frame. Given the bank, row means are independent and identically distributed in time and down the
frame; only single pixels repeat, every few thousand rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.model.seeds import generator

BANK = 1 << 22

Float32Array = NDArray[np.float32]
Int64Array = NDArray[np.int64]


class NoiseBank:
    """Standard normal noise for rows of a fixed length.

    Parameters
    ----------
    columns : int
        Pixels in a row.
    seed : int
        Seed of the simulation.
    """

    def __init__(self, columns: int, seed: int) -> None:
        bank = generator(seed, "pixel noise").standard_normal(BANK, dtype=np.float32)
        bank -= bank.mean()
        bank /= bank.std()
        ring = np.concatenate((bank, bank[: columns - 1]))
        self._rows = np.lib.stride_tricks.sliding_window_view(ring, columns)

    def places(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Int64Array:
        """Draw random positions in the bank, where rows begin."""
        return rng.integers(0, BANK, shape)

    def rows(self, places: Int64Array) -> Float32Array:
        """Noise of rows that begin at given positions, (len(places), columns), as a copy."""
        return self._rows[places]
