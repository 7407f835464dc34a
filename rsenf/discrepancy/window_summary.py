"""Summary of the workflow's result on one window, for publication and for comparison."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.result import SURE
from rsenf.discrepancy.verdict import Discovery
from rsenf.messages import FoundEffect
from rsenf.model import CaptureModel, Effect
from rsenf.model.parameters import fittings

Value = tuple[float, float]  # value, standard error
MOST_PLACES = 3
GONE_STDS = 4.0  # distance from neutral within which an effect counts as gone


@dataclass(frozen=True, eq=False)
class WindowSummary:
    """Result of one window.

    Attributes
    ----------
    verdict : str
    model : CaptureModel
        As found, without effects of earlier windows that are gone.
    effects : tuple of FoundEffect
        Effects of the model beyond those of the initial one.
    values : dict
        Fitted values by part and name.
    """

    verdict: str
    model: CaptureModel
    effects: tuple[FoundEffect, ...]
    values: dict[tuple[str, str], Value]


def seen_in(found: Discovery, given: CaptureModel, known: Sequence[FoundEffect]) -> WindowSummary:
    """Summarise a window.

    Parameters
    ----------
    found : Discovery
    given : CaptureModel
        Initial model of the first window.
    known : sequence of FoundEffect
        Effects of the window before, whose classes are kept.
    """
    values = _values(found)
    added = {e.members[0] if e.members else e.name: e for e in _added(found)}
    classes = {name: effect.members for effect in known for name in names_of(effect)}
    model, effects = found.last.theory.model, []
    for effect in model.effects:
        if effect.name in {old.name for old in given.effects}:
            continue
        if effect.name not in added and _does_nothing(effect, values):
            model = model.without(effect.name)
            continue
        members = classes.get(effect.name, ())
        blank = FoundEffect(name="" if members else effect.name, members=members)
        effects.append(_with_values(added.get(effect.name, blank), effect, values))
    parts = {"light", "shutter", *(effect.name for effect in model.effects)}
    values = {key: value for key, value in values.items() if key[0] in parts}
    return WindowSummary(found.verdict, model, tuple(effects), values)


def names_of(effect: FoundEffect) -> tuple[str, ...]:
    """All names that a found effect may have."""
    return effect.members or (effect.name,)


def rest_of(found: Discovery, gap_before: float) -> dict[str, Any]:
    """Return the message fields on what is unexplained, given the initial model's gap."""
    places = sorted((p for p in found.after if p.sure > SURE), key=lambda p: -p.share)
    lines = [p for p in places if p.axis == "alias_hz"]
    text = "; ".join(
        f"{100.0 * p.share:.0f} % of it at {p.axis} {p.low:.4g} to {p.high:.4g}"
        for p in places[:MOST_PLACES]
    )
    return {
        "unexplained_freq_hz": (lines[0].low + lines[0].high) / 2.0 if lines else math.nan,
        "unexplained_ratio": found.gap_after / gap_before,
        "unexplained_text": text,
    }


def _added(found: Discovery) -> Iterator[FoundEffect]:
    """Effects that the window added; in a class the fitted one comes first."""
    for step in found.steps:
        best = step.chosen
        assert best is not None
        yield FoundEffect(
            name=best.effect.name if len(step.kin) == 1 else "",
            members=step.kin if len(step.kin) > 1 else (),
            gap_before=step.before.gap.value,
            gap_after=best.fit.gap.value,
            evidence=best.nats / step.limit,
        )


def _with_values(
    blank: FoundEffect, effect: Effect, values: dict[tuple[str, str], Value]
) -> FoundEffect:
    """Fill in an effect's parameters, and the standard errors of the fitted ones."""
    parameters = dict(_parameters(effect))
    errors = [values.get((effect.name, name), (0.0, math.nan))[1] for name in parameters]
    return dataclasses.replace(
        blank,
        parameter_names=tuple(parameters),
        parameters=np.array(list(parameters.values()), np.float64),
        parameter_std=np.array(errors, np.float64),
    )


def _parameters(effect: Effect) -> Iterator[tuple[str, float]]:
    """Parameters of an effect as numbers: the rms of a series, the members of a list."""
    series = series_of(effect)
    for name, value in effect.to_dict().items():
        if series and name == series[0]:
            yield f"{name}.rms", float(np.sqrt(np.mean(np.square(value))))
        elif isinstance(value, list):
            yield from ((f"{name}.{k}", float(v)) for k, v in enumerate(value))
        elif isinstance(value, int | float):
            yield name, float(value)


def _values(found: Discovery) -> dict[tuple[str, str], Value]:
    """Fitted values; for a complex amplitude its size, with the larger error of its components."""
    out: dict[tuple[str, str], Value] = {}
    model = found.last.theory.model
    for knob, error in zip(found.last.knobs, found.last.stderr, strict=True):
        key = knob.part, knob.name + (f".{knob.index}" if knob.index >= 0 else "")
        value = knob.value(model)
        out[key] = value, max(float(error), out.get(key, (value, 0.0))[1])
    return out


def _does_nothing(effect: Effect, values: dict[tuple[str, str], Value]) -> bool:
    """Whether all fitted parameters of an effect are neutral within their errors."""
    tells = [(name, f.neutral) for name, f in fittings(effect).items() if f.neutral is not None]
    fitted = [
        (*value, neutral)
        for name, neutral in tells
        for (part, key), value in values.items()
        if part == effect.name and key.split(".")[0] == name
    ]
    return bool(fitted) and all(abs(v - neutral) < GONE_STDS * e for v, e, neutral in fitted)
