"""First harmonic of every row by itself, for the methods that aren't coherent."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.idle.moments import Moments, orders

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]


def row_tones(moments: Moments) -> tuple[Complex, Float]:
    """Half the complex amplitude of every row's first harmonic, and the row's level.

    Returns
    -------
    tone, level : ndarray, shape (rows,)
    """
    each = np.append(orders(1), 0)
    fit = np.linalg.solve(moments.gram(each), moments.response(each))
    return np.asarray(fit[1]), np.asarray(fit[2].real)


def coherence(tone: Complex, level: Float, turns: float) -> float:
    """Share of the tones that adds up along a ramp: 1 if all lie on it, about 0 by chance.

    Parameters
    ----------
    tone, level : ndarray, shape (rows,)
        As of :func:`row_tones`.
    turns : float
        Turns of the ramp down the rows.

    Examples
    --------
    >>> ramp = np.exp(2j * np.pi * 1.5 * np.arange(8) / 8)
    >>> round(coherence(ramp, np.ones(8), 1.5), 3), round(coherence(ramp, np.ones(8), -0.5), 3)
    (1.0, 0.0)
    """
    ramp = np.exp(2j * np.pi * turns * np.arange(tone.size) / tone.size)
    size = float(np.sum(level * np.abs(tone)))
    return float(np.abs(np.sum(level * tone * ramp.conj()))) / size if size > 0 else 0.0
