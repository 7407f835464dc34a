"""Ranks the effects of the catalogue by the share of the residual that each may explain.

An effect that is differentiable in its parameters is scored by one Gauss-Newton step: by how much
it reduces the training residual's sum of squares beyond what flicker, idle period, phase course and
wall could. An effect with a value for each frame or line is scored by cross-validation: the values
found on one half of the rows, applied to the other half. An effect that is only on or off can't be
scored without a fit.

Of a list of amplitudes, such as harmonics, the order is the last member that reduces the sum of
squares enough for its two parameters; all members before it stay.

Codec baseline: the fitted model's rows contain no discrepancy. What they have after the
recording's codec is due to the codec: its gap is added to the noise floor, and the gain that an
effect seems to have there is subtracted from its gain on the data.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.discrepancy.fit import Fit, fit
from rsenf.discrepancy.fit_parameters import FitParameter, neutral, parameters_of, series_of, within
from rsenf.discrepancy.jacobian import Jacobian, by_parameter
from rsenf.discrepancy.measured import Float32Array
from rsenf.discrepancy.residual_features import features_of
from rsenf.discrepancy.series import halves, power, response
from rsenf.model import CATALOGUE, Effect
from rsenf.model.parameters import Fitting, fittings

MORE = 4  # members added at a time
MIN_WALD = 16.0  # reduction of the sum of squares over the noise variance (Wald statistic)
# Scales the score of a series: an effect of few parameters ranks first if it explains this share.
SIMPLER = 0.97
KEPT = 3  # candidates that keep their Jacobians
# Encoders differ. BEYOND: factor by which the data must exceed the baseline (clips without an
# effect had 0.1 to 2.5 times the predicted gap, with x264 at several presets and rates). ANY: share
# of the baseline's gap that another encoder may put into the shape of any effect.
BEYOND, ANY = 3.0, 0.5
CODED_S = 20.0  # of the model that is coded: several groups of pictures


def with_order(
    effect: Effect, parameters: Sequence[FitParameter], worth: Mapping[Any, float]
) -> Effect:
    """Cut each list of an effect after its last significant member.

    Parameters
    ----------
    effect : Effect
    parameters : sequence of FitParameter
        All of the effect's.
    worth : mapping of (name, index) to float
        Increase of the sum of squares without each member, over the noise variance.
    """
    cut: dict[str, Any] = {}
    for name, fitting in fittings(effect).items():
        members = [
            parameter.member
            for parameter in parameters
            if parameter.name == name and parameter.index >= 0
        ]
        if not members:
            continue
        count = max((index + 1 for _, index in members if worth[name, index] > MIN_WALD), default=0)
        for parameter in filter(None, (name, fitting.turn)):
            cut[parameter] = getattr(effect, parameter)[:count]
    return dataclasses.replace(effect, **cut) if cut else effect


def with_more(effect: Effect, before: Effect, closed: set[str]) -> Effect:
    """Lengthen each list whose members were all significant, to test further ones.

    Parameters
    ----------
    effect, before : Effect
        After and before its lists were cut.
    closed : set of str
        Lists that were cut once, and stay as they are; updated.
    """
    longer: dict[str, Any] = {}
    for name, fitting in fittings(effect).items():
        values = getattr(effect, name)
        if not fitting.most or name in closed:
            continue
        if not values or len(values) < len(getattr(before, name)) or len(values) == fitting.most:
            closed.add(name)
            continue
        more = (0.0,) * min(MORE, fitting.most - len(values))
        for parameter in filter(None, (name, fitting.turn)):
            longer[parameter] = (*getattr(effect, parameter), *more)
    return dataclasses.replace(effect, **longer) if longer else effect


def held_out_worth(fit: Fit, part: str) -> dict[Any, float]:
    """Increase of the held-out sum of squares, over the noise variance, without each list member.

    Approximated by the linear response to the member's amplitude; ``part`` is the effect's name.
    """
    held, out = ~fit.data.training, dict[Any, float]()
    effect = next(e for e in fit.forward.model.effects if e.name == part)
    directions: dict[Any, list[tuple[FitParameter, np.ndarray]]] = {}
    for parameter, direction in zip(fit.parameters, fit.jacobian.grads, strict=True):
        if parameter.part == part and parameter.index >= 0:
            directions.setdefault(parameter.member, []).append((parameter, direction))
    residual = fit.residual[held]
    for member, of in directions.items():
        moved = np.zeros_like(residual)
        for parameter, direction in of:
            size, phase = getattr(effect, parameter.name)[parameter.index], 0.0
            if parameter.turn:
                phase = getattr(effect, parameter.turn)[parameter.index]
            along = size * (np.sin(phase) if parameter.across else np.cos(phase))
            moved += direction[held] * np.float32(along)
        more = float((moved * (moved + 2.0 * residual)).sum(dtype=np.float64))
        out[member] = more / fit.noise_var
    return out


@dataclass(frozen=True, eq=False)
class ScoredEffect:
    """An effect with initial values for a fit."""

    effect: Effect
    # share of the training residual's sum of squares that it may explain; infinite for an effect
    # that can only be fitted
    explains: float
    jacobian: Jacobian | None = None  # Jacobian for the first step of the fit, where it is known


def candidates(fit: Fit) -> list[ScoredEffect]:
    """Return a candidate for each guess of each effect that a fit's model lacks, the best first."""
    features = features_of(fit)
    # Effects count all frames, the features only those that were measured.
    at = np.searchsorted(fit.data.slot, np.arange(fit.data.slot[-1] + 1), "right") - 1
    by_slot = {name: getattr(features, name)[at] for name in ("angle_rad", "size_ratio")}
    features = dataclasses.replace(features, **by_slot)
    effects = fit.forward.model.effects
    there = {name for effect in effects for name in (effect.name, *effect.masks)}
    out: list[ScoredEffect] = []
    for name, kind in CATALOGUE.usable().items():
        if name in there:
            continue
        for values in kind.guesses(features):
            out = ranked([*out, weighed(fit, neutral(kind(**values)))])
    return out


def ranked(out: list[ScoredEffect]) -> list[ScoredEffect]:
    """Sort candidates, the best first; only the likeliest keep their Jacobians, which are large."""
    out = sorted(out, key=lambda c: -c.explains)
    return out[:KEPT] + [dataclasses.replace(c, jacobian=None) for c in out[KEPT:]]


def per_power(fit: Fit) -> float:
    """Mean square of a fit's training residual, relative to the flicker's power."""
    training = fit.data.training
    mean_square = float((fit.residual[training] ** 2).mean(dtype=np.float64))
    return mean_square / float((fit.flicker[training] ** 2).mean(dtype=np.float64))


def weighed(fit: Fit, effect: Effect) -> ScoredEffect:
    """Score an effect at its neutral values, which the fit's model lacks.

    It explains nothing if the step would leave the range of a parameter, such as a size below 0.
    """
    series = series_of(effect)
    if series:
        return _series(fit, effect, *series)
    parameters = parameters_of(effect, neutral=True)
    if not parameters:
        return ScoredEffect(effect, np.inf)
    forward = fit.forward.with_model(fit.forward.model.plus(effect))
    directions = [by_parameter(forward, fit.rows, fit.data, parameter) for parameter in parameters]
    jacobian = fit.jacobian.plus(parameters, directions)
    normal = jacobian.training.normal(fit.residual).over(fit.noise_var)
    lists = any(parameter.index >= 0 for parameter in parameters)
    worth = normal.worth([parameter.member for parameter in parameters]) if lists else {}
    shorter = with_order(effect, parameters, worth)
    if shorter != effect:
        kept = parameters_of(shorter, neutral=True)
        directions = [
            one for parameter, one in zip(parameters, directions, strict=True) if parameter in kept
        ]
        effect, parameters, jacobian = shorter, kept, fit.jacobian.plus(kept, directions)
        normal = jacobian.training.normal(fit.residual).over(fit.noise_var)
    steps = normal.solve()[len(normal.vector) - len(parameters) :]
    if any(within(effect, k.name, step) != step for k, step in zip(parameters, steps, strict=True)
           if k.bounded(effect)):  # fmt: skip
        return ScoredEffect(effect, 0.0)  # its size would be below 0
    rss = float((fit.residual[fit.data.training] ** 2).sum(dtype=np.float64))
    explained = normal.explained(len(directions))
    return ScoredEffect(effect, explained * fit.noise_var / rss, jacobian)


def _series(fit: Fit, effect: Effect, name: str, how: Fitting) -> ScoredEffect:
    """Score an effect that has one value for each frame or line."""
    direction = response(fit.forward, fit.rows, fit.data, effect, name, how)
    first, second = halves(direction, fit.residual, fit.jacobian.lit, fit.data, how)
    rss = float((fit.residual**2).sum(dtype=np.float64))
    explained = float((first * second * power(direction, fit.jacobian.lit, how)).sum())
    series = {**fit.jacobian.series, effect.name: direction}
    explains = SIMPLER * explained / rss
    return ScoredEffect(effect, explains, dataclasses.replace(fit.jacobian, series=series))


@dataclass(frozen=True)
class CodecBaseline:
    """Gap, and gains of effects, due to a codec alone."""

    gap: float  # relative to the flicker's power
    gains: Mapping[str, float]  # of each effect by name, relative to the same power

    @property
    def most(self) -> float:
        """Largest gap that an encoder of this kind may leave."""
        return BEYOND * self.gap

    def of(self, name: str) -> float:
        """Largest gain of an effect that such an encoder alone may cause."""
        return BEYOND * self.gains.get(_kind(name), 0.0) + ANY * self.gap


NOTHING = CodecBaseline(0.0, {})


def _kind(name: str) -> str:
    """Name of an effect without its number among those of its kind in a model."""
    return re.sub(r"_\d+$", "", name)


def baseline_of(
    fitted: Fit,
    recoded: Callable[[Float32Array], Float32Array] | None,
    among: Callable[[Fit], list[ScoredEffect]] | None = candidates,
) -> CodecBaseline:
    """Measure the codec baseline on the rows of a fitted model.

    Parameters
    ----------
    fitted : Fit
        Of the recording.
    recoded : callable or None
        Encodes and decodes rows (frames, rows, strips) as the recording was; None without a codec.
    among : callable, optional
        Returns the scored candidates; by default those of the catalogue. None: the gap alone is
        needed, which half as much shows.
    """
    if recoded is None:
        return NOTHING
    part = fitted.data.until(CODED_S if among else CODED_S / 2.0)
    level = part.as_lines(recoded(part.as_recorded(fitted.rows[: part.frames])))
    again = fit(fitted.forward, dataclasses.replace(part, level=level))
    scale, gains = per_power(again), dict[str, float]()
    for c in among(again) if among else ():
        if np.isfinite(c.explains):
            kind = _kind(c.effect.name)
            gains[kind] = max(gains.get(kind, 0.0), c.explains * scale)
    return CodecBaseline(abs(again.gap.value), gains)
