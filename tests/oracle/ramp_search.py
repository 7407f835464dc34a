"""Least squares of flicker on a ramp, over every single frame and row: slow and obvious."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


def explained_by_ramp(
    level: Float, phase_rad: Float, brightness: Float, turns: float, harmonics: int
) -> float:
    """Sum of squares that flicker on a ramp explains beyond a free constant for every row.

    Parameters
    ----------
    level : ndarray, shape (frames, rows)
    phase_rad : ndarray, shape (frames,)
    brightness : ndarray, shape (rows,)
        The flicker of a row is proportional to it.
    turns : float
        Of the first harmonic down the rows.
    harmonics : int
    """
    rows = level.shape[1]
    at = phase_rad[:, None] + 2 * np.pi * turns * np.arange(rows) / rows
    columns = []
    for k in range(1, harmonics + 1):
        for wave in (np.cos(k * at), np.sin(k * at)):
            column = wave * brightness
            columns.append((column - column.mean(axis=0)).ravel())
    design = np.stack(columns, axis=1)
    wanted = (level - level.mean(axis=0)).ravel()
    found, *_ = np.linalg.lstsq(design, wanted, rcond=None)
    return float(np.sum((design @ found) ** 2))
