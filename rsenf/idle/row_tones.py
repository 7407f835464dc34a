"""The first harmonic of every row on its own, as the older methods look at it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.idle.moments import Moments, orders

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]


def row_tones(moments: Moments) -> tuple[Complex, Float]:
    """Half the complex amplitude of every row's first harmonic, and the row's own level.

    Returns
    -------
    tone, level : ndarray, shape (rows,)
    """
    each = np.append(orders(1), 0)
    fit = np.linalg.solve(moments.gram(each), moments.response(each))
    return np.asarray(fit[1]), np.asarray(fit[2].real)


def coherence(tone: Complex, level: Float, turns: float) -> float:
    """Share of the tones that adds up along a ramp: 1 when all lie on it, about 0 by chance."""
    ramp = np.exp(2j * np.pi * turns * np.arange(tone.size) / tone.size)
    size = float(np.sum(level * np.abs(tone)))
    return float(np.abs(np.sum(level * tone * ramp.conj()))) / size if size > 0 else 0.0
