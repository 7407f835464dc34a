"""Summary of a residual, from which effects derive initial values for a search."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

GROSS = 3e-3  # gap if lines have the wrong times: as small as this if the flicker stands still
NOTHING_FITS = 0.3  # gap above which hardly any flicker is explained

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Residue:
    """Series and spectral lines of a residual.

    Attributes
    ----------
    gap : float
        Systematic power over the flicker's; about 1 or more if nothing fits, below zero if
        neighbouring rows have opposite errors.
    comb : float
        The same for rows two apart: exceeds the gap if errors alternate from row to row.
    turns_per_frame : float
        Periods of the light in a frame period.
    angle_rad : ndarray (frames,)
        Phase by which each frame's flicker leads the model's, −π to π.
    size_ratio : ndarray (frames,)
        Amplitude of each frame's flicker over the model's.
    tones_hz : tuple of float
        Frequencies of light that explain the strongest spectral line, the likeliest first; mains
        harmonics, including half orders, are excluded.
    pattern : tuple of float or None
        Stripes in the picture's height and how many pass a place per second, which explain the
        strongest line; None if light can.
    row_course : ndarray (captured frames,)
        Course over time, of rms 1, that a pattern of the rows' gains follows; empty if there is
        none.
    """

    gap: float
    comb: float
    turns_per_frame: float
    angle_rad: FloatArray
    size_ratio: FloatArray
    tones_hz: tuple[float, ...]
    pattern: tuple[float, float] | None = None
    row_course: FloatArray = field(default_factory=lambda: np.empty(0))
