"""Bounds: how exact an ENF value can be at best, and how frequent an error that was never seen."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

CONFIDENCE = 0.95


def enf_bound_hz(
    *,
    noise_level: float,
    amplitude_level: Sequence[float],
    rows: int,
    frame_rate_hz: float,
    read_out_time_s: float,
    seconds: float = 1.0,
) -> float:
    """Smallest standard error of a mean ENF that a stretch of row means allows by itself.

    The Cramér–Rao bound of the frequency of a tone in white noise, its phase unknown, amplitudes
    and the rows' own levels known (Rife and Boorstyn 1974, written for samples at any times).
    Harmonic ``k`` follows the phase ``k`` times as fast, so that a sample has the information
    ``Σ (k·A_k)² / 2σ²`` on it. What the seconds before and after tell of a frequency that moves
    slowly isn't in it: an estimator that uses them may do better.

    Parameters
    ----------
    noise_level : float
        Standard deviation of the noise of one row's mean, levels.
    amplitude_level : sequence of float
        Amplitudes of the harmonics 1, 2, … of the flicker, levels.
    rows : int
    frame_rate_hz, read_out_time_s : float
    seconds : float
        Length of the stretch.

    Returns
    -------
    float
        Hz of the ENF; infinite where there is no flicker.
    """
    frame_s = np.arange(max(round(seconds * frame_rate_hz), 1)) / frame_rate_hz
    t_s = frame_s[:, None] + np.arange(rows) * (read_out_time_s / rows)
    order = np.arange(1, len(amplitude_level) + 1)
    of_phase = float(np.sum((order * np.asarray(amplitude_level)) ** 2)) / (2 * noise_level**2)
    of_slope = of_phase * float(np.sum((t_s - t_s.mean()) ** 2))
    # The slope is the angular frequency of light, which is twice the ENF's.
    return 1 / (4 * math.pi * math.sqrt(of_slope)) if of_slope > 0 else math.inf


def rate_bound(events: int, trials: int) -> float:
    """Rate that so few events refute with 95 % confidence, one-sided (Clopper and Pearson 1934)."""
    from scipy.special import betaincinv

    if events >= trials:
        return 1.0
    return float(betaincinv(events + 1, trials - events, CONFIDENCE))


def count_bound(events: int) -> float:
    """Mean number of events that so few refute with 95 % confidence, one-sided, of a Poisson law.

    Over the time watched, it bounds the rate (Garwood 1936).
    """
    from scipy.special import gammaincinv

    return float(gammaincinv(events + 1, CONFIDENCE))


def rate_interval(events: int, trials: int) -> tuple[float, float]:
    """Rates that so many events are consistent with, 95 %, two-sided (Clopper and Pearson)."""
    from scipy.special import betaincinv

    tail = (1 - CONFIDENCE) / 2
    low = betaincinv(events, trials - events + 1, tail) if events else 0.0
    high = betaincinv(events + 1, trials - events, 1 - tail) if events < trials else 1.0
    return float(low), float(high)
