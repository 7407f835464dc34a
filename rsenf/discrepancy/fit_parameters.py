"""Fit parameters of a model, one by one, in units in which they act alike."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rsenf.model import CaptureModel, Effect
from rsenf.model.parameters import Fitting, fittings


@dataclass(frozen=True)
class FitParameter:
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
    index : int
        Of a parameter that is a list: which of its members; else −1.
    """

    part: str
    name: str
    step: float
    turn: str = ""
    across: bool = False
    index: int = -1

    @property
    def member(self) -> tuple[str, int]:
        """Name and place of its parameter: of both parts of an amplitude the same."""
        return self.name, self.index

    def bounded(self, effect: Effect) -> bool:
        """Whether an effect that does nothing yet can go but one way with it."""
        low = next(f.metadata["low"] for f in dataclasses.fields(effect) if f.name == self.name)
        return not self.turn and low == fittings(effect)[self.name].neutral == 0.0

    def value(self, model: CaptureModel) -> float:
        """Return the parameter in a model."""
        return self._of(_part(model, self.part), self.name)

    def _of(self, held: Any, name: str) -> float:
        told = getattr(held, name)
        return float((told if self.index < 0 else told[self.index]) or 0.0)

    def _put(self, held: Any, name: str, value: float) -> Any:
        told = getattr(held, name)
        return value if self.index < 0 else (*told[: self.index], value, *told[self.index + 1 :])

    def moved(self, model: CaptureModel, by: float) -> CaptureModel:
        """Return the model with this coordinate moved."""
        held = _part(model, self.part)
        if not self.turn:
            value = within(held, self.name, self._of(held, self.name) + by)
            value = max(value, LEAST_FLICKER) if self == FLICKER else value
            return _with(model, self.part, **{self.name: self._put(held, self.name, value)})
        size, phase = self._of(held, self.name), self._of(held, self.turn)
        along, across = size * math.cos(phase), size * math.sin(phase)
        along, across = (along, across + by) if self.across else (along + by, across)
        size = within(held, self.name, math.hypot(along, across))
        turned = {self.name: size, self.turn: math.atan2(across, along)}
        turned = {name: self._put(held, name, value) for name, value in turned.items()}
        return _with(model, self.part, **turned)


LEAST_FLICKER = 1e-4  # without any no phase could be fitted, and nothing else
FLICKER = FitParameter("light", "flicker_ratio", 1e-3)
IDLE = FitParameter("shutter", "idle_ratio", 1e-3)


def knobs_of(effect: Effect, *, neutral: bool) -> list[FitParameter]:
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
        told = getattr(effect, name)
        for index in range(len(told)) if isinstance(told, tuple) else (-1,):
            out.append(FitParameter(effect.name, name, fitting.step, fitting.turn, index=index))
            if fitting.turn:
                out.append(dataclasses.replace(out[-1], across=True))
    return out


def series_of(effect: type[Effect] | Effect) -> tuple[str, Fitting] | None:
    """Return the parameter of an effect that is a series, and how it is fitted; None for none."""
    return next(((name, f) for name, f in fittings(effect).items() if f.each), None)


def neutral(effect: Effect) -> Effect:
    """Return an effect that does nothing yet; what is not fitted stays as it is."""
    values: dict[str, float] = {}
    for name, fitting in fittings(effect).items():
        if fitting.neutral is not None and not fitting.each:
            values |= {name: fitting.neutral} | ({fitting.turn: 0.0} if fitting.turn else {})
    return filled(effect, values)


def filled(effect: Effect, values: Mapping[str, float]) -> Effect:
    """Return an effect with such parameters; every member of a list has the same."""
    told = {name: getattr(effect, name) for name in values}
    return dataclasses.replace(effect, **{
        name: (value,) * len(told[name]) if isinstance(told[name], tuple) else value
        for name, value in values.items()
    })  # fmt: skip


def turned(model: CaptureModel, knobs: Sequence[FitParameter], by: Sequence[float]) -> CaptureModel:
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
