"""Fit parameters: the coordinates of a capture model that a fit moves, scaled by their steps."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rsenf.model import CaptureModel, Effect
from rsenf.model.parameters import Fitting, fittings

LEAST_FLICKER = 1e-4  # without flicker the phase, and so all else, can't be fitted


@dataclass(frozen=True)
class FitParameter:
    """One coordinate of a model: a parameter, or one component of a complex amplitude."""

    part: str  # ``light``, ``shutter``, or the name of an effect
    name: str  # parameter
    step: float  # change within which the rows' response is linear
    turn: str = ""  # for an amplitude: the parameter that is its phase; else empty
    across: bool = False  # for an amplitude: whether this is the imaginary component
    index: int = -1  # for a list: which member; else −1

    @property
    def member(self) -> tuple[str, int]:
        """Name and index of its parameter, which both components of an amplitude have in common."""
        return self.name, self.index

    def bounded(self, effect: Effect) -> bool:
        """Whether a neutral effect can move in one direction only along this coordinate."""
        low = next(f.metadata["low"] for f in dataclasses.fields(effect) if f.name == self.name)
        return not self.turn and low == fittings(effect)[self.name].neutral == 0.0

    def value(self, model: CaptureModel) -> float:
        """Value of the parameter in a model."""
        return self._of(_part(model, self.part), self.name)

    def _of(self, held: Any, name: str) -> float:
        value = getattr(held, name)
        return float((value if self.index < 0 else value[self.index]) or 0.0)

    def _put(self, held: Any, name: str, value: float) -> Any:
        old = getattr(held, name)
        return value if self.index < 0 else (*old[: self.index], value, *old[self.index + 1 :])

    def moved(self, model: CaptureModel, by: float) -> CaptureModel:
        """Return the model with this coordinate changed, clipped to the parameter's range."""
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


FLICKER = FitParameter("light", "flicker_ratio", 1e-3)
IDLE = FitParameter("shutter", "idle_ratio", 1e-3)


def parameters_of(effect: Effect, *, neutral: bool) -> list[FitParameter]:
    """Return the fit parameters of an effect that hold for the whole clip, not those of a series.

    Parameters
    ----------
    effect : Effect
    neutral : bool
        Whether the effect is at its neutral values. Parameters without effect there, such as a
        tone's frequency, are then left out.
    """
    out = []
    for name, fitting in fittings(effect).items():
        if fitting.each or (neutral and fitting.neutral is None):
            continue
        value = getattr(effect, name)
        for index in range(len(value)) if isinstance(value, tuple) else (-1,):
            out.append(FitParameter(effect.name, name, fitting.step, fitting.turn, index=index))
            if fitting.turn:
                out.append(dataclasses.replace(out[-1], across=True))
    return out


def parameters_of_model(model: CaptureModel) -> list[FitParameter]:
    """Return all fit parameters of a model: of flicker, shutter and effects."""
    of_effects = (parameters_of(effect, neutral=False) for effect in model.effects)
    return [FLICKER, IDLE, *itertools.chain.from_iterable(of_effects)]


def series_of(effect: type[Effect] | Effect) -> tuple[str, Fitting] | None:
    """Return the parameter of an effect that is a series, and its fitting; None if it has none."""
    return next(((name, f) for name, f in fittings(effect).items() if f.each), None)


def any_course(effect: type[Effect] | Effect) -> bool:
    """Whether an effect can take on nearly any course over time, and so stand for another."""
    return effect.any_course or any(fitting.free for fitting in fittings(effect).values())


def neutral(effect: Effect) -> Effect:
    """Return an effect at its neutral values; parameters that aren't fitted stay unchanged."""
    values: dict[str, float] = {}
    for name, fitting in fittings(effect).items():
        if fitting.neutral is not None and not fitting.each:
            values |= {name: fitting.neutral} | ({fitting.turn: 0.0} if fitting.turn else {})
    return filled(effect, values)


def filled(effect: Effect, values: Mapping[str, float]) -> Effect:
    """Return an effect with parameters set; for a list the value of all members."""
    current = {name: getattr(effect, name) for name in values}
    return dataclasses.replace(effect, **{
        name: (value,) * len(current[name]) if isinstance(current[name], tuple) else value
        for name, value in values.items()
    })  # fmt: skip


def turned(
    model: CaptureModel, parameters: Sequence[FitParameter], by: Sequence[float]
) -> CaptureModel:
    """Return a model with several fit parameters changed, each by its own amount."""
    for parameter, step in zip(parameters, by, strict=True):
        model = parameter.moved(model, float(step))
    return model


def _part(model: CaptureModel, part: str) -> Any:
    if part in ("light", "shutter"):
        return getattr(model, part)
    return next(effect for effect in model.effects if effect.name == part)


def _with(model: CaptureModel, part: str, **values: Any) -> CaptureModel:
    changed = dataclasses.replace(_part(model, part), **values)
    if part in ("light", "shutter"):
        return dataclasses.replace(model, **{part: changed})
    return model.put(changed)


def within(held: Any, name: str, value: float) -> float:
    """Clip a value to the range of a part's parameter.

    >>> from rsenf.model import make_effect
    >>> within(make_effect("gamma", {}), "exponent", 5.0)
    3.0
    """
    meta = next(f.metadata for f in dataclasses.fields(held) if f.name == name)
    return float(min(max(value, meta["low"]), meta["high"]))
