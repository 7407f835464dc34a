"""ENF of one window the slow, obvious way: least squares at every frequency of a fine grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def tone_frequency(
    series: NDArray[np.complex128], t_s: NDArray[np.float64], around_hz: float, window_s: float
) -> float:
    """Frequency at which a constant plus one tone fit a Hann-weighted series best.

    ``t_s`` is relative to the window's centre.
    """
    weights = np.sqrt(np.cos(np.pi * t_s / window_s) ** 2)
    best = (np.inf, np.nan)
    for hz in around_hz + np.arange(-0.3, 0.3, 2e-4):
        basis = np.stack([np.ones_like(t_s), np.exp(2j * np.pi * hz * t_s)], axis=1)
        fit, *_ = np.linalg.lstsq(basis * weights[:, None], series * weights, rcond=None)
        left = float(np.sum(np.abs((series - basis @ fit) * weights) ** 2))
        best = min(best, (left, hz))
    return best[1]
