"""Fits lag and clock error of a clip to a reference, and tests hypotheses on what differs.

Model: the ENF is that predicted at a lag, plus a hypothesis, plus noise. Hypotheses: a constant
relative deviation, its drift, a step of the lag, any course. These data can attribute only the
first to the camera: ``clock_skew``. What varies in time might as well be the reference's; it
classifies the residual, and isn't added to the model.

Statistic: the log likelihood ratio of the held-out values with and without the hypothesis, for
Gaussian errors, ``(Σ r_0² − Σ r_1²) / 2σ²T``. The limit is Bonferroni's for the number of them.

Approximate: correlation of the errors is one factor, the integrated autocorrelation time ``T``
(:func:`memory`); steps of the fit are linear.

References
----------
Bayley, G. V. and Hammersley, J. M. (1946), The "effective" number of independent observations in an
autocorrelated time series, Supplement to the Journal of the Royal Statistical Society 8.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.clock_offset.clip import AlignedReference, slope_of
from rsenf.discrepancy.clock_offset.noise import Chance
from rsenf.discrepancy.forward_selection import FALSE_ALARMS, WORST
from rsenf.errors import InputError
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel
from rsenf.model.effects.shutter import ClockSkew

PLACES = 12  # times at which a step of the lag is tried
SURE_STDS = 4.0  # standard deviations of the gains by chance
LEAPT, DRIFTS, WANDERS, SKEWED = "lag_step", "clock_drift", "wander", "clock_skew"
MOST = 5
REST = np.array([0.1, 1.0])  # s and ppm: smaller steps are linear and need no new simulation
FARTHEST_S = 5.0  # largest change of the lag in one step


@dataclass(frozen=True, eq=False)
class Kind:
    """A hypothesis: how the clip's ENF may deviate."""

    name: str  # ``clock_skew``, ``clock_drift``, ``lag_step`` or ``wander``
    columns: FloatArray  # (n, parameters) Jacobian of the ENF (Hz per unit)
    at_s: float = math.nan  # time of a step; otherwise NaN


@dataclass(frozen=True, eq=False)
class ClockTrial:
    """A hypothesis tested on held-out values."""

    kind: Kind
    gain_hz2: float  # reduction of the held-out mean square
    nats: float  # log likelihood ratio of the held-out values
    worst: float  # least gain of a block, in standard errors
    least_hz2: float  # gain that chance rarely exceeds
    tried: int  # number of hypotheses

    @property
    def supported(self) -> bool:
        """Whether the held-out values support it, given the number of hypotheses."""
        enough = self.nats > math.log(self.tried / FALSE_ALARMS)
        return enough and self.gain_hz2 > self.least_hz2 and self.worst > WORST


def kinds(beside: AlignedReference, said_hz: FloatArray) -> Iterator[Kind]:
    """Yield the hypotheses, given the predicted ENF (n,)."""
    share = -1e-6 * np.nan_to_num(said_hz)
    yield Kind(SKEWED, share[:, None])
    middle_s = float(beside.t_s.mean())
    yield Kind(DRIFTS, np.stack([share, share * (beside.t_s - middle_s) / 60.0], axis=1))
    slope = slope_of(said_hz, beside.track.hop_s)
    places = np.linspace(beside.t_s[0], beside.t_s[-1], PLACES + 2)[1:-1]
    for at_s in places:
        yield Kind(LEAPT, (slope * (beside.t_s > at_s))[:, None], float(at_s))
    yield Kind(WANDERS, share[:, None] * _between(beside))


def weighed(
    beside: AlignedReference,
    kind: Kind,
    said_hz: FloatArray,
    residual_hz: FloatArray,
    chance: Chance,
    tried: int,
    filmed_hz: FloatArray | None = None,
) -> ClockTrial:
    """Fit a hypothesis and the lag to the training values, and test it on the held-out ones.

    Parameters
    ----------
    beside : AlignedReference
    kind : Kind
    said_hz, residual_hz : ndarray (n,)
        Prediction and residual of the model without it.
    chance : Chance
    tried : int
        Number of hypotheses.
    filmed_hz : ndarray (n,), optional
        Residual of a simulated model with it. Needed if the lag has absorbed a clock error and is
        too far off for a linear step.
    """
    slope = slope_of(said_hz, beside.track.hop_s)[:, None]
    known = np.isfinite(residual_hz) & (True if filmed_hz is None else np.isfinite(filmed_hz))
    training, held = beside.training & known, beside.held_out & known
    both = np.concatenate([slope, kind.columns], axis=1)
    solve, solve_lag = np.linalg.pinv(both[training]), np.linalg.pinv(slope[training])

    def residual_of(values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residual without it (held-out) and with it (all)."""
        before = values - slope @ (solve_lag @ values[training])
        return before[held], values - both @ (solve @ values[training])

    before, whole = residual_of(residual_hz)
    if filmed_hz is not None:
        before, whole = residual_hz[held], filmed_hz
    sets = [residual_of(values) for values in chance.sets_hz]
    gains = np.array([(b**2).mean() - (a[held] ** 2).mean() for b, a in sets])
    after = whole[held]
    # The residual may be larger or more correlated than the simulated noise: take the larger.
    var = max(chance.var_hz2, float((after**2).mean()))
    together = max(memory(chance.sets_hz), memory(whole[None]))
    gain = before**2 - after**2
    return ClockTrial(
        kind,
        float(gain.mean()),
        float(gain.sum()) / (2.0 * var * together),
        _worst(gain, before - after, beside.block[held], var * together),
        float(gains.mean() + SURE_STDS * gains.std(ddof=1)),
        tried,
    )


def memory(sets_hz: FloatArray) -> float:
    """Integrated autocorrelation time of series (sets, n), samples (Bayley and Hammersley 1946).

    It is the factor by which correlation increases the variance of a mean.
    """
    values = np.nan_to_num(sets_hz - np.nanmean(sets_hz))
    spectrum = np.abs(np.fft.rfft(values, 2 * values.shape[1], axis=1)) ** 2
    there = np.abs(np.fft.rfft(np.isfinite(sets_hz) * 1.0, 2 * values.shape[1], axis=1)) ** 2
    pairs = np.fft.irfft(there.mean(axis=0))[: values.shape[1]]
    shared = np.fft.irfft(spectrum.mean(axis=0))[: values.shape[1]] / np.maximum(pairs, 1.0)
    alike = shared / shared[0]
    end = int(np.argmax(alike <= 0.0)) or alike.size
    return float(1.0 + 2.0 * alike[1:end].sum())


def _between(beside: AlignedReference) -> FloatArray:
    """Piecewise linear functions with nodes at the centres of the training blocks, (n, blocks)."""
    numbers = np.unique(beside.block[beside.training])
    middle_s = (numbers + 0.5) * beside.block_s
    return np.stack([np.interp(beside.t_s, middle_s, unit) for unit in np.eye(numbers.size)], 1)


def _worst(gain: FloatArray, change: FloatArray, block: FloatArray, var: float) -> float:
    """Least gain of a block, in standard errors."""
    out = []
    for number in np.unique(block):
        here = block == number
        out.append(gain[here].sum() / (2.0 * math.sqrt(var * (change[here] ** 2).sum()) + 1e-30))
    return float(min(out))


@dataclass(frozen=True, eq=False)
class LagFit:
    """A model at a lag in a reference."""

    model: CaptureModel
    lag_s: float
    said_hz: FloatArray  # (n,) predicted ENF, and measured minus predicted
    residual_hz: FloatArray


def settled(
    beside: AlignedReference,
    model: CaptureModel,
    lag_s: float,
    said_hz: FloatArray,
    *,
    skewed: bool,
) -> LagFit:
    """Fit the lag and, optionally, the clock error to the training values.

    Parameters
    ----------
    beside : AlignedReference
    model : CaptureModel
    lag_s : float
        Initial lag.
    said_hz : ndarray (n,)
        Prediction at that lag; simulated again after large steps.
    skewed : bool
        Whether to fit the clock error.

    Raises
    ------
    InputError
        When measurement and prediction have no values in common.
    """
    for _ in range(MOST):
        residual_hz = beside.enf_hz - said_hz
        training = beside.training & np.isfinite(residual_hz)
        if training.sum() < 2 or not (beside.held_out & np.isfinite(residual_hz)).any():
            raise InputError("nothing of what the model films can be tracked", "give another model")
        columns = columns_of(beside, said_hz, skewed=skewed)
        step = np.linalg.lstsq(columns[training], residual_hz[training], rcond=None)[0]
        step[0] = np.clip(step[0], -FARTHEST_S, FARTHEST_S)
        lag_s += float(step[0])
        model = skewed_by(model, float(step[1])) if skewed else model
        if (np.abs(step) < REST[: step.size]).all():
            said_hz = said_hz + columns @ step
            break
        said_hz = beside.said(model, lag_s)
    return LagFit(model, lag_s, said_hz, beside.enf_hz - said_hz)


def by_all_values(
    beside: AlignedReference, fit: LagFit, chance: Chance, *, skewed: bool
) -> tuple[CaptureModel, float, FloatArray]:
    """Fit lag and clock error to all values, after the held-out ones have served as a test.

    Returns the model, the lag (s), and the standard errors of both: from the simulated sets,
    increased if the residual is larger than theirs.
    """
    known = np.isfinite(fit.residual_hz)
    columns = columns_of(beside, fit.said_hz, skewed=skewed)
    solve = np.linalg.pinv(columns[known])
    step = solve @ fit.residual_hz[known]
    residual_hz = fit.residual_hz - columns @ step
    likely = chance.var_hz2 * memory(chance.sets_hz)
    more = max(float(np.nanvar(residual_hz)) * memory(residual_hz[None]) / likely, 1.0)
    stderr = np.std(chance.sets_hz[:, known] @ solve.T, axis=0, ddof=1) * math.sqrt(more)
    model = skewed_by(fit.model, float(step[1])) if skewed else fit.model
    return model, fit.lag_s + float(step[0]), stderr


def columns_of(beside: AlignedReference, said_hz: FloatArray, *, skewed: bool) -> FloatArray:
    """Jacobian of the predicted ENF by the lag (Hz/s) and, if ``skewed``, the clock (Hz/ppm)."""
    columns = [slope_of(said_hz, beside.track.hop_s)]
    if skewed:
        columns.append(-1e-6 * np.nan_to_num(said_hz))
    return np.stack(columns, axis=1)


def clock_ppm(model: CaptureModel) -> float:
    """Clock error of a model (ppm)."""
    return sum(e.clock_ppm for e in model.effects if isinstance(e, ClockSkew))


def skewed_by(model: CaptureModel, ppm: float) -> CaptureModel:
    """Return a model with ``ppm`` added to its clock error."""
    return model.with_effect(ClockSkew.name, clock_ppm=clock_ppm(model) + ppm)
