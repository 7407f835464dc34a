"""Course of the phase near 0 Hz: smoothed under the grid prior, its sign decided.

Bins' phases with their covariance (:mod:`rsenf.flicker.zero_alias`) are observations of a Gaussian
process (:mod:`rsenf.flicker.grid_prior`). Steps that lost frames make are found and taken off
first. The sign of the frequency's deviation depends on the read-out direction: if neither the fit
nor the size of the deviation determines it, the likelier one is taken, and the frequency about
which the other is mirrored is reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.acquire import SEARCH_HZ
from rsenf.flicker.cell_light import Light
from rsenf.flicker.frame_slips import leaps
from rsenf.flicker.grid_prior import FREE, MEAN_STD_HZ, NODES_PER_S, phase_prior
from rsenf.flicker.lines import SURE_LOG_ODDS, alias_hz, usual_log_odds
from rsenf.flicker.mains import NO_GRID, why_not
from rsenf.flicker.node_sums import at_frames
from rsenf.flicker.wander import wander_of
from rsenf.flicker.zero_alias import LIGHT_HZ, ZeroAlias
from rsenf.medians import MEDIAN_SQUARE

Float = NDArray[np.float64]

HALF = "light at the grid's own frequency, or at twice that with a strong second harmonic: which?"
# A lamp's second harmonic over its first, in the logarithm of the light, is seldom larger. If it
# is, the read-out time has to exclude a half-wave lamp by these log odds.
MOST_SECOND, LEAST_LOG_ODDS = 0.5, 3.0
FORWARD_LOG_ODDS = 2.0  # prior log odds that a camera reads its first row first
AROUND_S = 5.0  # on both sides of a bin, over which its frequency is averaged
MISFIT_S, LEAST_MISFIT = 0.5, 3.0  # margin around a second; least chi-squared that counts
# Largest mean squares of the prior's ten and forty leading directions after the free ones; 1 for a
# grid.
MAX_WANDER, MAX_FAST = 10.0, 5.0


@dataclass(frozen=True, eq=False)
class Course:
    """Phase of the light over a span, smoothed under the grid prior.

    Attributes
    ----------
    sign : int
        1 for a read-out from the first row to the last, −1 for the reverse.
    mirror_hz : float
        Frequency about which the light's is mirrored if the read-out runs the other way; NaN where
        its direction is known.
    measured_rad : ndarray, shape (bins,)
        Phases of the bins before smoothing, relative to the nominal frequency's.
    psi_rad : ndarray, shape (nodes,)
        Smoothed phase at the nodes.
    second_var_hz2 : ndarray, shape (nodes − 4,)
        Variance of the mean frequency over the second that begins at each node.
    slips : list of tuple
        Bins in which frames are lost, how many, and the turn of all bins, as
        :func:`rsenf.flicker.frame_slips.leaps` finds them. The phases go on over them.
    """

    sign: int
    mirror_hz: float
    measured_rad: Float
    psi_rad: Float
    second_var_hz2: Float
    slips: list[tuple[int, int, Float]]


def course_of(
    found: ZeroAlias,
    nominal_hz: float,
    rate_hz: float,
    rate_std_hz: float,
    start: int,
    end: int,
    light: Light | None,
) -> Course | str:
    """Smooth the phase under the grid prior; return the reason in words if it isn't mains light.

    Parameters
    ----------
    found : ZeroAlias
    nominal_hz, rate_hz, rate_std_hz : float
        Nominal grid frequency; frame rate and its standard error, which counts since the light's
        frequency is measured relative to a multiple of the frame rate.
    start, end : int
        Seconds between which the bins lie.
    light : Light, optional
        Statistics of the cells, if known.
    """
    if abs(alias_hz(nominal_hz, rate_hz)) < SEARCH_HZ and _may_be_half(found):
        return HALF
    t_s = found.t_s
    stands_hz = rate_hz * round(2.0 * nominal_hz / rate_hz)  # alias at exactly 0 Hz
    sign, is_known = direction_of(found, stands_hz - 2.0 * nominal_hz)
    phi = sign * found.phase_rad + 2.0 * np.pi * (stands_hz - 2.0 * nominal_hz) * t_s
    grid = phase_prior((end - start) * NODES_PER_S + 1)
    prior = grid.basis
    design = np.column_stack([at_frames(t_s - start, direction) for direction in prior.T])
    noise = found.phase_cov + 1e-12 * np.eye(t_s.size)
    weighed = np.linalg.solve(noise, design)
    precision = design.T @ weighed + np.eye(prior.shape[1])
    coefficient = np.linalg.solve(precision, weighed.T @ (phi - phi.mean()))
    off_hz = 2.0 * nominal_hz - stands_hz + _off_hz(prior @ coefficient, t_s - start, end - start)
    # A frame that is lost unseen turns the light by a frame period's worth.
    step_rad = 2.0 * np.pi * off_hz / rate_hz
    residual = phi - phi.mean() - design @ coefficient
    spread = max(float(np.median(residual**2 / np.diag(noise))) / MEDIAN_SQUARE, 1.0)
    slips = leaps(phi - phi.mean(), spread * noise + design @ design.T, step_rad)
    phi = phi - sum(turned for _, _, turned in slips)
    coefficient = np.asarray(np.linalg.solve(precision, weighed.T @ (phi - phi.mean())), np.float64)
    mean_hz, moves = coefficient[1] * MEAN_STD_HZ, coefficient[FREE:] ** 2
    if moves[:10].mean() > MAX_WANDER or moves[:40].mean() > MAX_FAST:
        return NO_GRID
    wander = wander_of(coefficient, precision, len(prior))
    why = why_not(2.0 * nominal_hz + mean_hz, nominal_hz, rate_hz, wander, light)
    if why:
        return why
    variance = grid.second_var_hz2(np.asarray(np.linalg.inv(precision), np.float64))
    variance *= _misfit(t_s - start, phi - phi.mean() - design @ coefficient, noise, variance.size)
    variance += (stands_hz / rate_hz * rate_std_hz) ** 2
    mirror_hz = np.nan if is_known else stands_hz
    psi = prior @ coefficient + phi.mean()
    return Course(sign, mirror_hz, phi, psi, variance, slips)


def _off_hz(psi_rad: Float, t_s: Float, length_s: float) -> Float:
    """Mean frequency of a phase at nodes, relative to the nominal, around each time."""
    ends_s = np.clip(t_s + np.array([[-AROUND_S], [AROUND_S]]), 0.0, length_s)
    turned = np.diff(at_frames(ends_s, psi_rad), axis=0)[0]
    return np.asarray(turned / (2.0 * np.pi * (ends_s[1] - ends_s[0])))


def _may_be_half(found: ZeroAlias) -> bool:
    """Whether light at half the frequency may make the same ramp, in twice the read-out time."""
    by_ramp_s = found.turns / LIGHT_HZ
    off = (abs(found.read_out_s) - by_ramp_s * np.array([1.0, 2.0])) / found.read_out_std
    log_odds = float(off[1] ** 2 - off[0] ** 2) / 2.0
    is_unusual = found.series.size > 1 and abs(found.series[1]) > MOST_SECOND * found.amplitude
    return log_odds < (LEAST_LOG_ODDS if is_unusual else -LEAST_LOG_ODDS)


def _misfit(t_s: Float, residual_rad: Float, noise: Float, nodes: int) -> Float:
    """Reduced chi-squared of the bins around each second that begins at a node; 1 unless large.

    A lost frame that the time stamps don't show makes a step that no smooth course fits.
    """
    excess = residual_rad**2 / np.diag(noise)
    begins_s = np.arange(nodes)[:, None] / NODES_PER_S
    near = (t_s > begins_s - MISFIT_S) & (t_s < begins_s + 1.0 + MISFIT_S)
    chi2 = near @ excess / np.maximum(near.sum(axis=1), 1)
    return np.where(chi2 > LEAST_MISFIT, chi2, 1.0)


def direction_of(found: ZeroAlias, stands_off_hz: float) -> tuple[int, bool]:
    """Read-out direction, from the fit or from which deviation is the more usual.

    Parameters
    ----------
    found : ZeroAlias
    stands_off_hz : float
        Deviation from the nominal frequency at which the alias is exactly 0 Hz.

    Returns
    -------
    sign : int
        1 from the first row to the last, −1 the reverse: the likelier one.
    is_known : bool
    """
    if found.direction:
        return found.direction, True
    slope_hz = float(np.polyfit(found.t_s, found.phase_rad, 1)[0]) / (2.0 * np.pi)
    forward, reverse = stands_off_hz + slope_hz, stands_off_hz - slope_hz
    log_odds = usual_log_odds(forward, reverse)
    return (1 if log_odds + FORWARD_LOG_ODDS > 0.0 else -1), abs(log_odds) > SURE_LOG_ODDS
