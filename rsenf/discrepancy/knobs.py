"""What can be turned on a model: parameters in units in which they act alike, one by one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rsenf.model import CaptureModel, Effect
from rsenf.model.parameters import Fitting, fittings


@dataclass(frozen=True)
class Knob:
    """One coordinate of a model: a parameter's distance from neutral, or a part of an amplitude.

    Attributes
    ----------
    part : str
        ``light``, ``shutter``, or the name of an effect.
    name : str
        Parameter.
    step : float
        Change whose consequences are proportional to it.
    turn : str
        Parameter that is its phase, if it is an amplitude.
    across : bool
        Of an amplitude: the part at a right angle.
    """

    part: str
    name: str
    step: float
    turn: str = ""
    across: bool = False

    def moved(self, model: CaptureModel, by: float) -> CaptureModel:
        """Return the model with this coordinate moved."""
        held = _part(model, self.part)
        if not self.turn:
            value = within(held, self.name, getattr(held, self.name) + by)
            value = max(value, LEAST_FLICKER) if self == FLICKER else value
            return _with(model, self.part, **{self.name: value})
        size, phase = getattr(held, self.name), getattr(held, self.turn) or 0.0
        along, across = size * math.cos(phase), size * math.sin(phase)
        along, across = (along, across + by) if self.across else (along + by, across)
        size = within(held, self.name, math.hypot(along, across))
        turned = {self.name: size, self.turn: math.atan2(across, along)}
        return _with(model, self.part, **turned)


LEAST_FLICKER = 1e-4  # without any no phase could be fitted, and nothing else
FLICKER = Knob("light", "flicker_ratio", 1e-3)
IDLE = Knob("shutter", "idle_ratio", 1e-3)


def knobs_of(effect: Effect, *, neutral: bool) -> list[Knob]:
    """Return the knobs of an effect: for the whole clip, and none of a series.

    Parameters
    ----------
    effect : Effect
    neutral : bool
        Whether the effect does nothing yet, so that what only tells beside others is left out.
    """
    out = []
    for name, fitting in fittings(effect).items():
        if fitting.each or (neutral and fitting.neutral is None):
            continue
        out.append(Knob(effect.name, name, fitting.step, fitting.turn))
        if fitting.turn:
            out.append(Knob(effect.name, name, fitting.step, fitting.turn, across=True))
    return out


def series_of(effect: type[Effect] | Effect) -> tuple[str, Fitting] | None:
    """Return the parameter of an effect that is a series, and how it is fitted; None for none."""
    return next(((name, f) for name, f in fittings(effect).items() if f.each), None)


def neutral(effect: Effect) -> Effect:
    """Return an effect that does nothing yet; what is not fitted stays as it is."""
    values: dict[str, Any] = {}
    for name, fitting in fittings(effect).items():
        if fitting.neutral is not None and not fitting.each:
            values[name] = fitting.neutral
            values |= {fitting.turn: 0.0} if fitting.turn else {}
    return dataclasses.replace(effect, **values)


def turned(model: CaptureModel, knobs: Sequence[Knob], by: Sequence[float]) -> CaptureModel:
    """Return a model with several knobs moved."""
    for knob, step in zip(knobs, by, strict=True):
        model = knob.moved(model, float(step))
    return model


def _part(model: CaptureModel, part: str) -> Any:
    if part in ("light", "shutter"):
        return getattr(model, part)
    return next(effect for effect in model.effects if effect.name == part)


def _with(model: CaptureModel, part: str, **values: Any) -> CaptureModel:
    changed = dataclasses.replace(_part(model, part), **values)
    if part in ("light", "shutter"):
        return dataclasses.replace(model, **{part: changed})
    effects = tuple(changed if effect.name == part else effect for effect in model.effects)
    return dataclasses.replace(model, effects=effects)


def within(held: Any, name: str, value: float) -> float:
    """Keep a value within the plausible range of a parameter."""
    meta = next(f.metadata for f in dataclasses.fields(held) if f.name == name)
    return float(min(max(value, meta["low"]), meta["high"]))
