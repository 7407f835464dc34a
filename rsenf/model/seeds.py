"""Random numbers: one generator for each purpose and each block of frames.

The numbers of a block depend on seed, purpose and block only. So a clip is the beginning of a
longer one, and changing one part doesn't change the noise of another.
"""

from __future__ import annotations

import zlib

import numpy as np


def generator(seed: int, purpose: str, block: int = 0) -> np.random.Generator:
    """Return the generator for one purpose and one block.

    Parameters
    ----------
    seed : int
        The simulation's seed, 0 or more.
    purpose : str
        What the numbers are for, for example ``"row noise"``.
    block : int, optional
        Which block of frames.
    """
    return np.random.default_rng([seed, zlib.crc32(purpose.encode()), block])
