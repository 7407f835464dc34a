"""What a simpler model leaves of a recording, as effects may look at it for where to begin."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

GROSS = 3e-3  # gap of lines at the wrong times: so small where the flicker stands still
NOTHING_FITS = 0.3  # gap from which on hardly anything of the flicker is explained

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Residue:
    """Series and lines of what is left.

    Attributes
    ----------
    gap : float
        Systematic part of what is left, over the flicker's power; about 1 or more where nothing
        fits, and below zero where neighbouring rows are wrong in opposite ways.
    comb : float
        The same of rows two apart: more than the gap where rows are wrong by turns.
    turns_per_frame : float
        Turns of the light in a frame period.
    angle_rad : ndarray (frames,)
        By which each frame's flicker is ahead of the model's, between −π and π.
    size_ratio : ndarray (frames,)
        Size of each frame's flicker over the model's.
    tones_hz : tuple of float
        Frequencies at which light would leave the lines that stand out of the residual, what
        stands out most first; none of them a multiple of half the light's own.
    pattern : tuple of float or None
        Stripes down the picture's height, and how many pass a place in a second, that would leave
        the line that stands out most; None where light at some frequency would.
    row_course : ndarray (captured frames,)
        Course over time, of rms 1, that the gains of the rows have in common where they differ;
        empty where they don't.
    """

    gap: float
    comb: float
    turns_per_frame: float
    angle_rad: FloatArray
    size_ratio: FloatArray
    tones_hz: tuple[float, ...]
    pattern: tuple[float, float] | None = None
    row_course: FloatArray = field(default_factory=lambda: np.empty(0))
