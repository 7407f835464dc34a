"""Fits the lag and, optionally, the clock error of a clip to a reference, by Gauss-Newton steps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.clock_offset.aligned_reference import AlignedReference, slope_of
from rsenf.discrepancy.clock_offset.hypotheses import memory
from rsenf.discrepancy.clock_offset.noise import Chance
from rsenf.errors import InputError
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel
from rsenf.model.effects.shutter import ClockSkew

MOST = 5
REST = np.array([0.1, 1.0])  # s and ppm: smaller steps are linear and need no new simulation
FARTHEST_S = 5.0  # largest change of the lag in one step


@dataclass(frozen=True, eq=False)
class LagFit:
    """A model at a lag in a reference.

    Attributes
    ----------
    model : CaptureModel
    lag_s : float
    said_hz, residual_hz : ndarray (n,)
        Predicted ENF, and measured minus predicted.
    """

    model: CaptureModel
    lag_s: float
    said_hz: FloatArray
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
