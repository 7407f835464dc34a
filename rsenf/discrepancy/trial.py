"""Fits a candidate jointly with the rest of the model, and judges it by held-out rows.

The statistic is the log likelihood ratio of the held-out rows, with and without the effect, for
white Gaussian noise: the reduction of their sum of squares over twice the noise variance. Parts of
the data are tested with standard errors that include systematic residuals (cluster-robust, over
blocks of time).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.candidates import (
    CodecBaseline,
    ScoredEffect,
    held_out_worth,
    with_more,
    with_order,
)
from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.fit_parameters import parameters_of, parameters_of_model, series_of
from rsenf.discrepancy.forward_model import ForwardModel, plan
from rsenf.discrepancy.gap import by_block
from rsenf.discrepancy.measured import BANDS, Float32Array, Part
from rsenf.discrepancy.residual_features import features_of
from rsenf.discrepancy.series import all_as_declared, halves, held, summed_up, with_series
from rsenf.discrepancy.start import begun_anew, misfit
from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray
from rsenf.model import Effect
from rsenf.model.effects import DeliveryEffect
from rsenf.model.parameters import Fitting

STEPS = 5  # of a candidate's first fit
TO_REST = 24  # of the best ones' fit: slow where a series depends on a parameter

NOISE_STDS = 3.0  # a loss beyond this counts as one
PIECES = 8  # of a block of time, for its standard error
HOPELESS = 3.0  # initial misfit over that without the effect, above which no fit is tried
KEEPS = 0.999  # share of the log likelihood ratio that a converged fit must keep


@dataclass(frozen=True, eq=False)
class Trial:
    """A fitted candidate."""

    effect: Effect  # with its fitted parameters
    fit: Fit
    gain: float  # reduction of the held-out mean square, over the flicker's power
    nats: float  # log likelihood ratio of the held-out rows, with and without the effect
    worst: float  # least gain of a block of time, band of rows or strip, in standard errors
    lost: float = 0.0  # sum of significant losses of such parts, over the gains of the others
    baseline: float = 0.0  # gain that a codec alone may cause

    @property
    def beyond(self) -> float:
        """Gain beyond that of a codec alone."""
        return self.gain - self.baseline


def trial_of(before: Fit, candidate: ScoredEffect, baseline: CodecBaseline) -> Trial | None:
    """Fit a candidate jointly with the rest of the model.

    None if the fit fails, or a series isn't of the kind that its effect declares.
    """
    try:
        begun = _with_effect(before, candidate.effect)
        if begun is None:
            return None
        after = fit(begun, before.data, most=STEPS, jacobian=candidate.jacobian)
    except (UsageError, np.linalg.LinAlgError):  # steps have led to an invalid model
        return None
    forward = after.forward
    if not all_as_declared(forward.model.effects, forward.course.weights.size, forward.wall):
        return None
    return judged(before, after, candidate.effect.name, baseline)


def judged(before: Fit, after: Fit, name: str, baseline: CodecBaseline) -> Trial:
    """Compare the held-out residuals of two fits, with and without an effect.

    Parameters
    ----------
    before, after : Fit
        Without and with it.
    name : str
        Of the effect.
    baseline : CodecBaseline
    """
    data, others = before.data, ~before.data.training
    less, moved = _less(before, after, data.second)
    paid, by = _less(before, after, data.first)
    block = data.block[others]
    gain, count = by_block(less.mean(axis=(1, 2), dtype=np.float64)[others], block)
    values = count * float(less[0].size)
    held_out = less[others], moved[others]
    worst = min(
        *_by_time(*held_out, after),
        *(_sure(*part, after) for axis in (1, 2) for part in _parts(*held_out, axis)),
        # The half that the phase course was fitted to must not become worse, either.
        _sure(paid[others], by[others], after),
    )
    power = float((before.flicker[others] ** 2).mean(dtype=np.float64))
    nats = float((gain * values).sum() / (2.0 * after.noise_var))
    mean = float((gain * values).sum() / values.sum())
    effect = next(e for e in after.forward.model.effects if e.name == name)
    lost = max(_lost(parts, after) for parts in (
        [(less[others][block == n], moved[others][block == n]) for n in np.unique(block)],
        *(_parts(*held_out, axis) for axis in (1, 2)),
        [held_out, (paid[others], by[others])],
    ))  # fmt: skip
    return Trial(effect, after, mean / power, nats, worst, lost, baseline.of(name))


def converged(before: Fit, trial: Trial, baseline: CodecBaseline) -> Trial:
    """Fit a trial to convergence, select the order of its lists, and summarise its series.

    The earlier fit is kept if it has the higher likelihood.
    """
    best, name = trial, trial.effect.name
    try:
        # Anew: a derivative of the trial's Jacobian is 0 where the effect's size was.
        on = fit(trial.fit.forward, trial.fit.data, most=TO_REST)
        on = _with_its_order(on, name)
        again = judged(before, on, name, baseline)
        best = again if again.nats >= KEEPS * trial.nats else trial
    except (UsageError, np.linalg.LinAlgError):
        pass  # keep the earlier fit
    after, effects = best.fit.restored(), []
    for effect in after.forward.model.effects:
        series = series_of(effect)
        effects.append(_in_numbers(after, effect, *series) if series else effect)
    model = dataclasses.replace(after.forward.model, effects=tuple(effects))
    after = dataclasses.replace(after, forward=after.forward.with_model(model))
    effect = next(e for e in effects if e.name == trial.effect.name)
    return dataclasses.replace(best, effect=effect, fit=after)


def _with_its_order(on: Fit, name: str) -> Fit:
    """Fit as many members of an effect's lists as the held-out rows support."""
    closed: set[str] = set()
    while True:
        held = next(e for e in on.forward.model.effects if e.name == name)
        parameters = [parameter for parameter in on.parameters if parameter.part == name]
        if not any(parameter.index >= 0 for parameter in parameters):
            return on
        shorter = with_order(held, parameters, held_out_worth(on, name))
        other = with_more(shorter, held, closed)
        if other == held:
            return on
        model = on.forward.model.put(other)
        forward, data = on.forward.with_model(model), on.data
        near = on.jacobian.of_parameters(parameters_of_model(model), forward, forward.rows(data))
        del on  # frees its arrays
        on = fit(forward, data, most=TO_REST, jacobian=near)
        if other == shorter:
            return on


def _in_numbers(after: Fit, effect: Effect, name: str, how: Fitting) -> Effect:
    """Return an effect with the parameters that summarise its series."""
    direction = after.jacobian.series[effect.name]
    moved = halves(direction, after.residual, after.jacobian.lit, after.data, how)
    values = np.array(getattr(effect, name))
    if how.each == "frame":  # one for each delivered frame
        values = values[plan(after.forward.model, after.data).number[after.data.slot]]
    step_s = 1.0 / float(after.data.frame_rate)
    return summed_up(effect, values + moved[0], values + moved[1], step_s, after.data.group)


def _with_effect(before: Fit, effect: Effect) -> ForwardModel | None:
    """Return a fit's forward model with an effect at neutral; None where a fit has no prospect."""
    series, model = series_of(effect), before.forward.model.plus(effect)
    if isinstance(effect, DeliveryEffect):
        ahead_rad = features_of(before).angle_rad
        return before.forward.otherwise_delivered(model, before.data, ahead_rad)
    if series is None and not parameters_of(effect, neutral=True):
        # Without the effect nothing has fitted, so begin with the course before the fit.
        begun = begun_anew(before.begun.with_model(model), before.data)
        hopeless = misfit(begun, before.data) > HOPELESS * misfit(before.begun, before.data)
        return None if hopeless else begun
    if series is None:
        return before.forward.with_model(model)
    values = held(before.forward, before.data, effect, *series)
    return with_series(before.forward, effect, series[0], values)


def _less(before: Fit, after: Fit, part: Part) -> tuple[Float32Array, Float32Array]:
    """Reduction of a part's squared residual, and the square of the residual's change."""
    was, now = before.residual[part], after.residual[part]
    return was**2 - now**2, (was - now) ** 2


def _by_time(less: np.ndarray, moved: np.ndarray, after: Fit) -> Iterator[float]:
    """Gain of each held-out block of time in standard errors, as :func:`_sure` defines them."""
    block = after.data.block[~after.data.training]
    gains = less.mean(axis=(1, 2), dtype=np.float64)
    for number in np.unique(block):
        in_block = block == number
        pieces = [piece.mean() for piece in np.array_split(gains[in_block], PIECES) if piece.size]
        change = moved[in_block].mean(dtype=np.float64)
        white = _noise(change, less[in_block].size, after)
        yield float(np.mean(pieces) / max(white, _stderr_of(pieces)))


def _parts(less: np.ndarray, moved: np.ndarray, axis: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Split gains and changes into bands of rows, or into strips."""
    parts = min(BANDS, less.shape[axis])
    return list(zip(*(np.array_split(a, parts, axis) for a in (less, moved)), strict=True))


def _lost(parts: Sequence[tuple[np.ndarray, np.ndarray]], after: Fit) -> float:
    """Sum of the significant losses of parts, over the sum of the others' gains."""
    gains = [float(less.sum(dtype=np.float64)) for less, _ in parts]
    noise = [_noise(float(m.mean(dtype=np.float64)), m.size, after) * m.size for _, m in parts]
    lost = sum(-g for g, n in zip(gains, noise, strict=True) if g < -NOISE_STDS * n)
    return lost / max(sum(g for g in gains if g > 0.0), 1e-30)


def _sure(less: np.ndarray, moved: np.ndarray, after: Fit) -> float:
    """Mean gain of held-out frames in standard errors, of white noise or cluster-robust."""
    gains, change = less.mean(axis=(1, 2), dtype=np.float64), moved.mean(dtype=np.float64)
    white = _noise(change, less.size, after)
    blocks, _ = by_block(gains, after.data.block[~after.data.training])
    return float(gains.mean() / max(white, _stderr_of(blocks)))


def _stderr_of(means: Sequence[float] | FloatArray) -> float:
    """Standard error of the mean of several means."""
    return float(np.std(means, ddof=1) / np.sqrt(len(means))) if len(means) > 1 else 0.0


def _noise(change: float, values: int, after: Fit) -> float:
    """Standard error of a mean gain by white noise, from the residual's mean square change."""
    return float(2.0 * np.sqrt(after.noise_var * change / values) + 1e-30)
