"""Bounds: the Cramér–Rao bound of the ENF, and confidence bounds of rates and counts of events."""

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
    """Return the Cramér–Rao bound of the mean ENF over an interval of row means.

    Of the frequency of a tone in white noise with unknown phase, and known amplitudes and texture
    (Rife and Boorstyn 1974, here for samples at any times). Harmonic ``k`` has ``k`` times
    the phase, so a sample has Fisher information ``Σ (k·A_k)² / 2σ²`` on it. An estimator that also
    uses the time before and after can have a smaller error, since the ENF varies slowly.

    Parameters
    ----------
    noise_level : float
        Standard deviation of the noise of one row's mean, levels.
    amplitude_level : sequence of float
        Amplitudes of the harmonics 1, 2, … of the flicker, levels.
    rows : int
        Of a frame.
    frame_rate_hz, read_out_time_s : float
    seconds : float
        Length of the interval.

    Returns
    -------
    float
        Standard deviation, Hz of the ENF; infinite without flicker.
    """
    frame_s = np.arange(max(round(seconds * frame_rate_hz), 1)) / frame_rate_hz
    t_s = frame_s[:, None] + np.arange(rows) * (read_out_time_s / rows)
    order = np.arange(1, len(amplitude_level) + 1)
    of_phase = float(np.sum((order * np.asarray(amplitude_level)) ** 2)) / (2 * noise_level**2)
    of_slope = of_phase * float(np.sum((t_s - t_s.mean()) ** 2))
    # The slope is the angular frequency of the flicker, which has twice the ENF.
    return 1 / (4 * math.pi * math.sqrt(of_slope)) if of_slope > 0 else math.inf


def rate_bound(events: int, trials: int) -> float:
    """Return the one-sided 95 % upper bound of a binomial rate (Clopper and Pearson 1934).

    >>> round(rate_bound(0, 300), 4)
    0.0099
    """
    from scipy.special import betaincinv

    if events >= trials:
        return 1.0
    return float(betaincinv(events + 1, trials - events, CONFIDENCE))


def count_bound(events: int) -> float:
    """Return the one-sided 95 % upper bound of a Poisson mean (Garwood 1936).

    Divided by the observation time, it bounds the rate.
    """
    from scipy.special import gammaincinv

    return float(gammaincinv(events + 1, CONFIDENCE))


def rate_interval(events: int, trials: int) -> tuple[float, float]:
    """Return the two-sided 95 % interval of a binomial rate (Clopper and Pearson 1934)."""
    from scipy.special import betaincinv

    tail = (1 - CONFIDENCE) / 2
    low = betaincinv(events, trials - events + 1, tail) if events else 0.0
    high = betaincinv(events + 1, trials - events, 1 - tail) if events < trials else 1.0
    return float(low), float(high)
