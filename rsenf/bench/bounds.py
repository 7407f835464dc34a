"""Bounds: how exact an ENF value can be at best, and how frequent an error that was never seen."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

CONFIDENCE = 0.95


def enf_bound_hz(
    flicker_levels: Sequence[float],
    row_noise_level: float,
    rows: int,
    frame_rate_hz: float,
    read_out_time_s: float,
    seconds: float = 1.0,
) -> float:
    """Smallest standard error of a mean ENF that a stretch of row means allows by itself.

    The Cramér–Rao bound of the frequency of a tone with harmonics in white noise, its amplitudes,
    phase, and the rows' own levels known (Rife and Boorstyn 1974, written for real samples at any
    times): harmonic ``k`` follows the phase ``k`` times as fast, so the information on the phase
    is ``Σ (k·A_k)² / 2σ²`` a sample. What the seconds before and after tell of a frequency that
    moves slowly isn't in it, so an estimator that uses them may do better.

    Parameters
    ----------
    flicker_levels : sequence of float
        Amplitudes of harmonics 1, 2, … in the row means, levels.
    row_noise_level : float
        Standard deviation of a row mean, levels.
    rows : int
        Rows of a frame.
    frame_rate_hz, read_out_time_s : float
    seconds : float
        Length of the stretch.

    Returns
    -------
    float
        Hz of the ENF; infinite where there is no flicker.
    """
    order = np.arange(1, len(flicker_levels) + 1)
    phase_information = float(np.sum((order * np.asarray(flicker_levels)) ** 2)) / 2
    phase_information /= row_noise_level**2
    frame_s = np.arange(max(round(seconds * frame_rate_hz), 1)) / frame_rate_hz
    t_s = frame_s[:, None] + np.arange(rows) * (read_out_time_s / rows)
    information = phase_information * float(np.sum((t_s - t_s.mean()) ** 2))
    # Of the angular frequency of light, which is twice the ENF's.
    return 1 / (4 * math.pi * math.sqrt(information)) if information > 0 else math.inf


def rate_bound(events: int, trials: int) -> float:
    """Rate that so few events refute with 95 % confidence, one-sided (Clopper and Pearson 1934)."""
    from scipy.special import betaincinv

    if events >= trials:
        return 1.0
    return float(betaincinv(events + 1, trials - events, CONFIDENCE))
