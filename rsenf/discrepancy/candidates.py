"""Ranks the effects of the catalogue by the share of the residual that each may explain.

An effect that is differentiable in its parameters is scored by one Gauss-Newton step: by how much
it reduces the training residual's sum of squares beyond what flicker, idle period, phase course and
wall could. An effect with a value for each frame or line is scored by cross-validation: the values
found on one half of the rows, applied to the other half. An effect that is only on or off can't be
scored without a fit.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.fit_parameters import knobs_of, neutral, series_of, within
from rsenf.discrepancy.jacobian import Jacobian, by_knob
from rsenf.discrepancy.order import with_order
from rsenf.discrepancy.residue import residue_of
from rsenf.discrepancy.series import halves, power, response
from rsenf.model import CATALOGUE, Effect
from rsenf.model.parameters import Fitting

# Scales the score of a series: an effect of few parameters ranks first if it explains this share.
SIMPLER = 0.97
KEPT = 3  # candidates that keep their Jacobians


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect with initial values for a fit.

    Attributes
    ----------
    effect : Effect
    explains : float
        Share of the training residual's sum of squares that it may explain; infinite for an effect
        that can only be fitted.
    slopes : Jacobian or None
        Jacobian for the first step of the fit, where it is known.
    """

    effect: Effect
    explains: float
    slopes: Jacobian | None = None


def candidates(fit: Fit) -> list[Candidate]:
    """Return a candidate for each guess of each effect that a fit's model lacks, the best first."""
    residue = residue_of(fit)
    effects = fit.theory.model.effects
    there = {name for effect in effects for name in (effect.name, *effect.masks)}
    out: list[Candidate] = []
    for name, kind in CATALOGUE.usable().items():
        if name in there:
            continue
        for values in kind.guesses(residue):
            made = weighed(fit, neutral(kind(**values)))
            if made is None:
                continue
            out = sorted([*out, made], key=lambda c: -c.explains)
            # Jacobians are large: only candidates likely to be fitted keep theirs.
            out[KEPT:] = [dataclasses.replace(c, slopes=None) for c in out[KEPT:]]
    return out


def seeming_gains(fit: Fit) -> dict[str, float]:
    """Apparent gain of the best candidate of each effect, relative to the flicker's power."""
    scale, out = per_power(fit), dict[str, float]()
    for c in candidates(fit):
        if np.isfinite(c.explains):
            out.setdefault(c.effect.name, c.explains * scale)
    return out


def per_power(fit: Fit) -> float:
    """Mean square of a fit's training residual, relative to the flicker's power."""
    training = fit.data.training
    mean_square = float((fit.residual[training] ** 2).mean(dtype=np.float64))
    return mean_square / float((fit.flicker[training] ** 2).mean(dtype=np.float64))


def weighed(fit: Fit, effect: Effect) -> Candidate | None:
    """Score an effect at its neutral values, which the fit's model lacks.

    None if the step would leave the range of a parameter, such as a size below 0.
    """
    series = series_of(effect)
    if series:
        return _series(fit, effect, *series)
    knobs = knobs_of(effect, neutral=True)
    if not knobs:
        return Candidate(effect, np.inf)
    theory = fit.theory.with_model(fit.theory.model.plus(effect))
    directions = [by_knob(theory, fit.rows, fit.data, knob) for knob in knobs]
    slopes = fit.slopes.plus(knobs, directions)
    normal = slopes.training.normal(fit.residual).over(fit.noise_var)
    lists = any(knob.index >= 0 for knob in knobs)
    worth = normal.worth([knob.member for knob in knobs]) if lists else {}
    shorter = with_order(effect, knobs, worth)
    if shorter != effect:
        kept = knobs_of(shorter, neutral=True)
        directions = [one for knob, one in zip(knobs, directions, strict=True) if knob in kept]
        effect, knobs, slopes = shorter, kept, fit.slopes.plus(kept, directions)
        normal = slopes.training.normal(fit.residual).over(fit.noise_var)
    steps = normal.solve()[len(normal.vector) - len(knobs) :]
    if any(within(effect, k.name, step) != step for k, step in zip(knobs, steps, strict=True)
           if k.bounded(effect)):  # fmt: skip
        return None  # its size would be below 0
    rss = float((fit.residual[fit.data.training] ** 2).sum(dtype=np.float64))
    explained = normal.explained(len(directions))
    return Candidate(effect, explained * fit.noise_var / rss, slopes)


def _series(fit: Fit, effect: Effect, name: str, how: Fitting) -> Candidate:
    """Score an effect that has one value for each frame or line."""
    direction = response(fit.theory, fit.rows, fit.data, effect, name, how)
    first, second = halves(direction, fit.residual, fit.slopes.lit, fit.data, how)
    rss = float((fit.residual**2).sum(dtype=np.float64))
    explained = float((first * second * power(direction, fit.slopes.lit, how)).sum())
    series = {**fit.slopes.series, effect.name: direction}
    explains = SIMPLER * explained / rss
    return Candidate(effect, explains, dataclasses.replace(fit.slopes, series=series))
