"""Bounds: how exact an ENF value can be at best, and how frequent an error that was never seen."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

CONFIDENCE = 0.95


def phase_information(flicker_levels: Sequence[float], row_noise_level: float) -> float:
    """Fisher information of one row mean on the phase of the flicker, 1/rad².

    Averaged over the phase: harmonic ``k`` follows it ``k`` times as fast, so it gives
    ``(k·A_k)² / 2σ²``.

    Parameters
    ----------
    flicker_levels : sequence of float
        Amplitudes of harmonics 1, 2, … in the row means, levels.
    row_noise_level : float
        Standard deviation of a row mean, levels.
    """
    order = np.arange(1, len(flicker_levels) + 1)
    return float(np.sum((order * np.asarray(flicker_levels)) ** 2)) / (2 * row_noise_level**2)


def enf_bound_hz(
    information: float,
    rows: int,
    frame_rate_hz: float,
    read_out_time_s: float,
    seconds: float = 1.0,
) -> float:
    """Smallest standard error of a mean ENF that a stretch of row means allows by itself.

    The Cramér–Rao bound of the frequency of a tone in white noise, its phase unknown, amplitudes
    and the rows' own levels known (Rife and Boorstyn 1974, written for samples at any times). What
    the seconds before and after tell of a frequency that moves slowly isn't in it, so an estimator
    that uses them may do better.

    Parameters
    ----------
    information : float
        Of each row mean, from :func:`phase_information`.
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
    frame_s = np.arange(max(round(seconds * frame_rate_hz), 1)) / frame_rate_hz
    t_s = frame_s[:, None] + np.arange(rows) * (read_out_time_s / rows)
    of_slope = information * float(np.sum((t_s - t_s.mean()) ** 2))
    # The slope is the angular frequency of light, which is twice the ENF's.
    return 1 / (4 * math.pi * math.sqrt(of_slope)) if of_slope > 0 else math.inf


def idle_bound_ratio(
    information: float, rows: int, frames: int, frame_rate_hz: float, f0_hz: float
) -> float:
    """Smallest standard error of an idle ratio that a clip's row means allow.

    The Cramér–Rao bound of the slope of the phase down the rows, ``2π·f_0·T_ro`` a frame, with a
    phase of its own for each frame, amplitudes and the rows' own levels known.

    Parameters
    ----------
    information : float
        Of each row mean, from :func:`phase_information`.
    rows, frames : int
    frame_rate_hz : float
    f0_hz : float
        Illumination frequency.

    Returns
    -------
    float
        Of the ratio; infinite where there is no flicker.
    """
    down = np.arange(rows) / rows
    of_slope = information * frames * float(np.sum((down - down.mean()) ** 2))
    return frame_rate_hz / (2 * math.pi * f0_hz * math.sqrt(of_slope)) if of_slope > 0 else math.inf


def rate_bound(events: int, trials: int) -> float:
    """Rate that so few events refute with 95 % confidence, one-sided (Clopper and Pearson 1934)."""
    from scipy.special import betaincinv

    if events >= trials:
        return 1.0
    return float(betaincinv(events + 1, trials - events, CONFIDENCE))
