"""One candidate fitted jointly with all there is, and judged by rows that nothing was fitted to."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.candidates import Candidate
from rsenf.discrepancy.codec_baseline import CodecBaseline
from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.fit_parameters import knobs_of, series_of
from rsenf.discrepancy.forward_model import ForwardModel, plan
from rsenf.discrepancy.gap import by_block, by_block_of
from rsenf.discrepancy.measured import BANDS, Float32Array, Part
from rsenf.discrepancy.order import held_out_worth, with_more, with_order
from rsenf.discrepancy.residue import residue_of
from rsenf.discrepancy.series import all_as_told, halves, held, summed_up, with_series
from rsenf.discrepancy.start import begun_anew, misfit
from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray
from rsenf.model import Effect
from rsenf.model.effects import DeliveryEffect
from rsenf.model.parameters import Fitting

STEPS = 5  # in which a candidate is fitted, at first
TO_REST = 24  # in which the best is: where a series follows a knob, it goes step by step

NOISE_STDS = 3.0  # from which on a part fares worse beyond its noise
PIECES = 8  # of a block of time
HOPELESS = 3.0  # of what is left before anything is fitted, that an effect may leave then
KEEPS = 0.999  # of what it told, that a fit with fewer parameters or nearer to rest must tell


@dataclass(frozen=True, eq=False)
class Trial:
    """One candidate fitted.

    Attributes
    ----------
    effect : Effect
        As it was fitted.
    fit : Fit
    gain : float
        By how much less is left of held-out rows, over the power of the flicker.
    nats : float
        Logarithm of the likelihood ratio of those rows, with it and without.
    worst : float
        Gain in the block of time, band of rows or strip that fares worst, in standard errors.
    lost : float
        What all that fare worse lose, beyond the noise, over what the others gain.
    usual : float
        What a codec alone may have it gain.
    """

    effect: Effect
    fit: Fit
    gain: float
    nats: float
    worst: float
    lost: float = 0.0
    usual: float = 0.0

    @property
    def beyond(self) -> float:
        """Gain beyond what is usual."""
        return self.gain - self.usual


def tried(before: Fit, candidate: Candidate, usual: CodecBaseline) -> Trial | None:
    """Fit a candidate jointly with all there is; None where no fit is found."""
    try:
        begun = _with_effect(before, candidate.effect)
        if begun is None:
            return None
        after = fit(begun, before.data, most=STEPS, slopes=candidate.slopes)
    except (UsageError, np.linalg.LinAlgError):  # steps have led to what can't be
        return None
    if not all_as_told(after.theory.model.effects, after.theory.course.weights.size):
        return None
    return judged(before, after, candidate.effect.name, usual)


def judged(before: Fit, after: Fit, name: str, usual: CodecBaseline) -> Trial:
    """Judge what an effect, by its name, has made better."""
    data, others = before.data, ~before.data.training
    less, moved = _less(before, after, data.second)
    paid, by = _less(before, after, data.first)
    gain, count = by_block(less.mean(axis=(1, 2), dtype=np.float64), data, others)
    values = count * float(less[0].size)
    held_out = less[others], moved[others]
    worst = min(
        *_by_time(*held_out, after),
        *(_worst(*held_out, axis, after) for axis in (1, 2)),
        # Nor may those pay for it that the course of the phase was found from.
        _sure(paid[others], by[others], after),
    )
    power = float((before.flicker[others] ** 2).mean(dtype=np.float64))
    nats = float((gain * values).sum() / (2.0 * after.noise_var))
    mean = float((gain * values).sum() / values.sum())
    effect = next(e for e in after.theory.model.effects if e.name == name)
    block = data.block[others]
    lost = max(_lost(parts, after) for parts in (
        [(less[others][block == n], moved[others][block == n]) for n in np.unique(block)],
        *(_parts(*held_out, axis) for axis in (1, 2)),
        [held_out, (paid[others], by[others])],
    ))  # fmt: skip
    return Trial(effect, after, mean / power, nats, worst, lost, usual.of(name))


def settled(before: Fit, trial: Trial, usual: CodecBaseline) -> Trial:
    """Fit a trial on until it rests, unless that makes it worse, and sum its series up."""
    best, name = trial, trial.effect.name
    try:
        begun = trial.fit.restored()
        on = fit(begun.theory, begun.data, most=TO_REST, slopes=begun.slopes)
        del begun  # its arrays are much
        on = _with_its_order(on, name)
        again = judged(before, on, name, usual)
        best = again if again.nats >= KEEPS * trial.nats else trial
    except (UsageError, np.linalg.LinAlgError):
        pass  # as far as it was is as far as it goes
    after, told = best.fit.restored(), []
    for effect in after.theory.model.effects:
        series = series_of(effect)
        told.append(_in_numbers(after, effect, *series) if series else effect)
    model = dataclasses.replace(after.theory.model, effects=tuple(told))
    after = dataclasses.replace(after, theory=after.theory.with_model(model))
    effect = next(e for e in told if e.name == trial.effect.name)
    return dataclasses.replace(best, effect=effect, fit=after)


def _with_its_order(on: Fit, name: str) -> Fit:
    """Fit with as many members of an effect's lists as held-out rows support."""
    closed: set[str] = set()
    while True:
        held = next(e for e in on.theory.model.effects if e.name == name)
        knobs = [knob for knob in on.knobs if knob.part == name]
        if not any(knob.index >= 0 for knob in knobs):
            return on
        shorter = with_order(held, knobs, held_out_worth(on, name))
        other = with_more(shorter, held, closed)
        if other == held:
            return on
        model = on.theory.model.without(name).plus(other)
        theory, data = on.theory.with_model(model), on.data
        del on  # its arrays are much
        on = fit(theory, data, most=TO_REST)
        if other == shorter:
            return on


def _in_numbers(after: Fit, effect: Effect, name: str, how: Fitting) -> Effect:
    """Return an effect with the numbers that its series comes to."""
    direction = after.slopes.series[effect.name]
    moved = halves(direction, after.residual, after.slopes.lit, after.data, how)
    values = np.array(getattr(effect, name))
    if how.each == "frame":  # as they were delivered
        values = values[plan(after.theory.model, after.data).number[after.data.slot]]
    step_s = 1.0 / float(after.data.frame_rate)
    return summed_up(effect, values + moved[0], values + moved[1], step_s, after.data.group)


def _with_effect(before: Fit, effect: Effect) -> ForwardModel | None:
    """Return a fit's theory with an effect that does nothing yet; None for one that can't be."""
    told, model = series_of(effect), before.theory.model.plus(effect)
    if isinstance(effect, DeliveryEffect):
        ahead_rad = residue_of(before).angle_rad
        return before.theory.otherwise_delivered(model, before.data, ahead_rad)
    if told is None and not knobs_of(effect, neutral=True):
        # Without it nothing has fitted: what steps have made of the course is of no use.
        begun = begun_anew(before.begun.with_model(model), before.data)
        hopeless = misfit(begun, before.data) > HOPELESS * misfit(before.begun, before.data)
        return None if hopeless else begun
    if told is None:
        return before.theory.with_model(model)
    values = held(before.theory, before.data, effect, *told)
    return with_series(before.theory, effect, told[0], values)


def _less(before: Fit, after: Fit, part: Part) -> tuple[Float32Array, Float32Array]:
    """By how much less is left of some rows, squared, and the square of what has changed."""
    was, now = before.residual[part], after.residual[part]
    return was**2 - now**2, (was - now) ** 2


def _by_time(less: np.ndarray, moved: np.ndarray, after: Fit) -> Iterator[float]:
    """Gain in each held-out block of time, in standard errors, as :func:`_sure` has them."""
    block = after.data.block[~after.data.training]
    gains = less.mean(axis=(1, 2), dtype=np.float64)
    for number in np.unique(block):
        own = block == number
        pieces = [piece.mean() for piece in np.array_split(gains[own], PIECES) if piece.size]
        change = moved[own].mean(dtype=np.float64)
        white = _noise(change, less[own].size, after)
        yield float(np.mean(pieces) / max(white, _stderr_of(pieces)))


def _worst(less: np.ndarray, moved: np.ndarray, axis: int, after: Fit) -> float:
    """Gain in the band of rows, or the strip, that fares worst, in standard errors."""
    return min(_sure(own, change, after) for own, change in _parts(less, moved, axis))


def _parts(less: np.ndarray, moved: np.ndarray, axis: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Split gains and changes into bands of rows, or strips."""
    parts = min(BANDS, less.shape[axis])
    return list(zip(*(np.array_split(a, parts, axis) for a in (less, moved)), strict=True))


def _lost(parts: Sequence[tuple[np.ndarray, np.ndarray]], after: Fit) -> float:
    """What parts that fare worse beyond their noise lose, over what the others gain."""
    gains = [float(less.sum(dtype=np.float64)) for less, _ in parts]
    noise = [_noise(float(m.mean(dtype=np.float64)), m.size, after) * m.size for _, m in parts]
    lost = sum(-g for g, n in zip(gains, noise, strict=True) if g < -NOISE_STDS * n)
    return lost / max(sum(g for g in gains if g > 0.0), 1e-30)


def _sure(less: np.ndarray, moved: np.ndarray, after: Fit) -> float:
    """Mean gain of held-out frames, in standard errors.

    By the noise of rows, or by how much the gains of blocks of time differ, if that is more: what
    is left unexplained makes them differ, too (a cluster-robust standard error).
    """
    gains, change = less.mean(axis=(1, 2), dtype=np.float64), moved.mean(dtype=np.float64)
    white = _noise(change, less.size, after)
    blocks, _ = by_block_of(gains, after.data.block[~after.data.training])
    return float(gains.mean() / max(white, _stderr_of(blocks)))


def _stderr_of(means: Sequence[float] | FloatArray) -> float:
    """Return the standard error of the mean of several means."""
    return float(np.std(means, ddof=1) / np.sqrt(len(means))) if len(means) > 1 else 0.0


def _noise(change: float, values: int, after: Fit) -> float:
    """Standard error of a mean gain, by the mean square of what has changed."""
    return float(2.0 * np.sqrt(after.noise_var * change / values) + 1e-30)
