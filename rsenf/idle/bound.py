"""Cramér-Rao bound of the idle ratio: the least standard error of an unbiased estimator.

The model is a tone of known frequency in white noise whose phase runs down the rows: a row's
phase has the variance ``2σ²/(N·A²)`` after ``N`` frames, and the slope through ``L`` rows, equally
spaced over one frame, that of a phase times ``12/L`` in units of the whole ramp. Harmonic ``k``
turns ``k`` times as fast, and adds its information (Rife, D. C. and Boorstyn, R. R. (1974), IEEE
Trans. Information Theory 20, 591, for one tone).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsenf.errors import UsageError


def idle_ratio_bound(
    *,
    noise_level: float,
    amplitude_level: Sequence[float],
    frames: int,
    rows: int,
    frame_rate_hz: float,
    f0_hz: float,
) -> float:
    """Return the Cramér-Rao bound of the idle ratio, as a standard error.

    Parameters
    ----------
    noise_level : float
        Standard deviation of the noise of one row's mean, levels.
    amplitude_level : sequence of float
        Amplitudes of the harmonics 1, 2, … of the flicker, levels.
    frames, rows : int
    frame_rate_hz : float
    f0_hz : float
        Illumination frequency.

    Raises
    ------
    UsageError
        For fewer than two frames or rows, rates not above 0, or negative noise.

    Examples
    --------
    >>> bound = idle_ratio_bound(noise_level=0.5, amplitude_level=[10.0], frames=1800, rows=720,
    ...                          frame_rate_hz=29.97, f0_hz=100.0)
    >>> f"{bound:.1e}"
    '1.0e-05'
    """
    if min(frames, rows) < 2 or min(frame_rate_hz, f0_hz) <= 0 or noise_level < 0:
        raise UsageError(
            f"no bound for {frames} frames of {rows} rows at {frame_rate_hz:g} frames/s",
            "two frames and two rows at least, and positive rates",
        )
    order = np.arange(1, len(amplitude_level) + 1)
    power = float(np.sum((order * np.asarray(amplitude_level, np.float64)) ** 2))
    if power <= 0.0:
        return float("inf")
    turns_std = np.sqrt(24.0 / (frames * rows * power)) * noise_level / (2.0 * np.pi)
    return float(turns_std * frame_rate_hz / f0_hz)
