"""Of how many members a list of amplitudes is: as many as the data carry, and no more.

The order of a model is its last member that is worth its two parameters; those before it stay.
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

MORE = 4  # members at a time
LEAST = 16.0  # by which the square of a residual, over the noise's variance, must shrink


def with_order(effect: Effect, knobs: Sequence[FitParameter], worth: Mapping[Any, float]) -> Effect:
    """Cut each list of an effect after its last member that is worth its place.

    Parameters
    ----------
    effect : Effect
    knobs : sequence of FitParameter
        All of its.
    worth : mapping of (name, index) to float
        By how much the square of the residual grows without each member, over the noise.
    """
    cut: dict[str, Any] = {}
    for name, fitting in fittings(effect).items():
        own = [knob.member for knob in knobs if knob.name == name and knob.index >= 0]
        if not own:
            continue
        count = max((index + 1 for _, index in own if worth[name, index] > LEAST), default=0)
        for parameter in filter(None, (name, fitting.turn)):
            cut[parameter] = getattr(effect, parameter)[:count]
    return dataclasses.replace(effect, **cut) if cut else effect


def with_more(effect: Effect, before: Effect, closed: set[str]) -> Effect:
    """Lengthen each list that needed all of its members, to see whether there are more.

    Parameters
    ----------
    effect, before : Effect
        After and before its lists were cut.
    closed : set of str
        Lists that were cut once, which stay as they are; it is added to.
    """
    longer: dict[str, Any] = {}
    for name, fitting in fittings(effect).items():
        told = getattr(effect, name)
        if not fitting.most or name in closed:
            continue
        if not told or len(told) < len(getattr(before, name)) or len(told) == fitting.most:
            closed.add(name)
            continue
        more = (0.0,) * min(MORE, fitting.most - len(told))
        for parameter in filter(None, (name, fitting.turn)):
            longer[parameter] = (*getattr(effect, parameter), *more)
    return dataclasses.replace(effect, **longer) if longer else effect


def held_out_worth(fit: Fit, part: str) -> dict[Any, float]:
    """By how much held-out rows fare worse without each member of a part's lists.

    By a linear step: what the rows do when it is turned, as far as it is.
    """
    held, out = ~fit.data.training, dict[Any, float]()
    effect = next(e for e in fit.theory.model.effects if e.name == part)
    directions: dict[Any, list[tuple[FitParameter, np.ndarray]]] = {}
    for knob, direction in zip(fit.knobs, fit.slopes.own, strict=True):
        if knob.part == part and knob.index >= 0:
            directions.setdefault(knob.member, []).append((knob, direction))
    left = fit.residual[held]
    for member, of in directions.items():
        moved = np.zeros_like(left)
        for knob, direction in of:
            size, phase = getattr(effect, knob.name)[knob.index], 0.0
            if knob.turn:
                phase = getattr(effect, knob.turn)[knob.index]
            along = size * (np.sin(phase) if knob.across else np.cos(phase))
            moved += direction[held] * np.float32(along)
        more = float((moved * (moved + 2.0 * left)).sum(dtype=np.float64))
        out[member] = more / fit.noise_var
    return out
