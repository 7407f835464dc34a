"""Coherent method: maximum likelihood over all frames, rows and harmonics; and its bound.

Model: flicker of the tracked phase runs down the rows by ``q`` turns (:mod:`rsenf.idle.ramp`); the
idle ratio is ``ρ = 1 − |q|·F_r/f_0``. If the alias is at 0 Hz (25 frames/s on 50 Hz, 30 on 60),
every row's flicker looks like texture, except for the grid's deviation, which turns all rows'
phases together: texture, ramp and phases are then fitted jointly (:mod:`rsenf.flicker.zero_alias`).
The mirror image fits as well: read-out from the last row, and the deviation with the other sign.

Likelihood: Gaussian, maximal over ``q``. The Cramér-Rao bound, in white noise: a row's phase has
the variance ``2σ²/(N·A²)`` after ``N`` frames, and the slope through ``L`` rows that of a phase
times ``12/L``, in units of the whole ramp. Harmonic ``k`` turns ``k`` times as fast, and adds its
information.

Approximate: the flicker's phase is taken as known. The variance is the largest of jackknife over
bands of rows, bend of the rows' phases, scatter over segments of the stream, and the bound: a
codec's errors aren't white. Segments that scatter far more are refused: a zoom, or a cut.

References
----------
- Rife, D. C. and Boorstyn, R. R. (1974), Single tone parameter estimation from discrete-time
  observations, IEEE Trans. Information Theory 20, 591.
- Hajj-Ahmad, A., Berkovich, A. and Wu, M. (2016), Exploiting power signatures for camera forensics,
  IEEE Signal Processing Letters 23, 713: the ramp and the read-out time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rsenf.errors import UsageError
from rsenf.flicker.lines import alias_hz
from rsenf.flicker.mains import MIN_FLICKER_RATIO
from rsenf.flicker.near_dc import SPAN_S, course_of, direction_of
from rsenf.flicker.zero_alias import ZeroAlias
from rsenf.idle.estimator_state import EstimatorState, Finding
from rsenf.idle.moments import coherence, row_tones
from rsenf.idle.ramp import Profile, bend_var, find_ramp, freedom, jackknife_var, segment_turns
from rsenf.idle.refusals import (
    CHANGES,
    MIN_COHERENCE,
    NO_FLICKER,
    NO_RAMP,
    STILL,
    TOO_SHORT,
    WEAK,
    hardly_turned,
    is_weak,
    refused,
)

BEYOND = 1.05  # of the steepest ramp in a frame: its peak may lie a little outside
# Fewest segments that are compared; variance of their mean over the variance by other means, and
# standard deviation of their idle ratios, above which the read-out changes. The grid's frequency
# changes the turns, too.
MIN_SEGMENTS, CHANGED, LEAST_CHANGE_RATIO, GRID_RATIO = 4, 4.0, 0.01, 1e-3
EVERY_S = 4  # spans are whole multiples of this, so that few priors are computed


def still(seen: EstimatorState) -> Finding:
    """Estimate from the joint fit of texture and flicker."""
    if not seen.still_rows.enough:
        return TOO_SHORT
    fit = seen.still_rows.told_apart()
    if fit is None or not fit.is_flicker:
        return NO_FLICKER
    if fit.amplitude < MIN_FLICKER_RATIO:
        return WEAK
    if not fit.determined:
        return STILL
    why = _why_no_grid(seen, fit)
    return refused(why) if why else _claim(seen, fit)


def _why_no_grid(seen: EstimatorState, fit: ZeroAlias) -> str:
    """Return why the fitted flicker isn't a grid's light, from its first minutes; else ''."""
    end = int(min(fit.t_s[-1], fit.t_s[0] + SPAN_S) / EVERY_S + 1) * EVERY_S
    start = int(fit.t_s[0])
    part = fit.t_s < end
    early = replace(
        fit,
        t_s=fit.t_s[part],
        phase_rad=fit.phase_rad[part],
        phase_cov=fit.phase_cov[np.ix_(part, part)],
    )
    light = seen.still_rows.light
    course = course_of(
        early, seen.nominal_hz, seen.frame_rate_hz, 0.0, start, end, light, seen.unfiltered
    )
    return course if isinstance(course, str) else ""


def _claim(seen: EstimatorState, fit: ZeroAlias) -> Finding:
    """Report the ramp, and its direction if the fit or the usual deviation determines it."""
    turned = (fit.phase_rad[-1] - fit.phase_rad[0]) / (fit.t_s[-1] - fit.t_s[0])
    carrier_hz = 2.0 * seen.nominal_hz
    still_hz = carrier_hz - alias_hz(carrier_hz, seen.frame_rate_hz)
    sign, is_known = direction_of(fit, still_hz - carrier_hz)
    f0_hz = still_hz + sign * float(turned / (2.0 * np.pi))
    found = Finding.of_turns(sign * fit.turns, fit.turns_std**2, f0_hz)
    return found if is_known else found.undirected(still_hz)


def conclude(seen: EstimatorState) -> Finding:
    """Estimate from the most likely ramp down the rows (Hajj-Ahmad et al. 2016)."""
    if seen.stands_still:
        return still(seen)
    if hardly_turned(seen):
        return STILL
    ramp = find_ramp(seen.moments, BEYOND * seen.most_turns)
    if is_weak(seen, ramp.flicker_ratio):
        return WEAK
    tone, level = row_tones(seen.moments)
    if coherence(tone, level, ramp.turns) < MIN_COHERENCE:
        return NO_RAMP
    profile = Profile(seen.moments, seen.moments.harmonics(), ramp.brightness)
    variance = max(
        jackknife_var(profile, ramp.turns), bend_var(profile, ramp.turns), ramp.bound_var
    )
    of_segment = segment_turns(seen.segments, ramp)
    if of_segment.size >= MIN_SEGMENTS:
        segments_var = float(np.var(of_segment, ddof=1)) / of_segment.size
        idle = 1.0 - np.abs(of_segment) * seen.frame_rate_hz / seen.f0_hz
        if segments_var > CHANGED * variance + (GRID_RATIO * ramp.turns) ** 2:
            if float(np.std(idle)) > LEAST_CHANGE_RATIO:
                return refused(CHANGES.format(100.0 * idle.min(), 100.0 * idle.max()))
            variance = segments_var
    return Finding.of_turns(ramp.turns, variance, seen.f0_hz, freedom(ramp.brightness.size))


def idle_ratio_bound(
    *,
    noise_level: float,
    amplitude_level: Sequence[float],
    frames: int,
    rows: int,
    frame_rate_hz: float,
    f0_hz: float,
) -> float:
    """Return the Cramér-Rao bound of the idle ratio, as a standard error (Rife and Boorstyn 1974).

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
