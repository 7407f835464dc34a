"""Order selection: how many members of a list of amplitudes, such as harmonics, the data support.

The order is the last member that reduces the sum of squares enough for its two parameters; all
members before it stay.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.fit_parameters import FitParameter
from rsenf.model import Effect
from rsenf.model.parameters import fittings

MORE = 4  # members added at a time
LEAST = 16.0  # reduction of the sum of squares over the noise variance (Wald statistic)


def with_order(effect: Effect, knobs: Sequence[FitParameter], worth: Mapping[Any, float]) -> Effect:
    """Cut each list of an effect after its last significant member.

    Parameters
    ----------
    effect : Effect
    knobs : sequence of FitParameter
        All of the effect's.
    worth : mapping of (name, index) to float
        Increase of the sum of squares without each member, over the noise variance.
    """
    cut: dict[str, Any] = {}
    for name, fitting in fittings(effect).items():
        members = [knob.member for knob in knobs if knob.name == name and knob.index >= 0]
        if not members:
            continue
        count = max((index + 1 for _, index in members if worth[name, index] > LEAST), default=0)
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
    effect = next(e for e in fit.theory.model.effects if e.name == part)
    directions: dict[Any, list[tuple[FitParameter, np.ndarray]]] = {}
    for knob, direction in zip(fit.knobs, fit.slopes.grads, strict=True):
        if knob.part == part and knob.index >= 0:
            directions.setdefault(knob.member, []).append((knob, direction))
    residual = fit.residual[held]
    for member, of in directions.items():
        moved = np.zeros_like(residual)
        for knob, direction in of:
            size, phase = getattr(effect, knob.name)[knob.index], 0.0
            if knob.turn:
                phase = getattr(effect, knob.turn)[knob.index]
            along = size * (np.sin(phase) if knob.across else np.cos(phase))
            moved += direction[held] * np.float32(along)
        more = float((moved * (moved + 2.0 * residual)).sum(dtype=np.float64))
        out[member] = more / fit.noise_var
    return out
