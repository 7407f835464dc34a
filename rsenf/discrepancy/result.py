"""What was found, as plain values and as a model file."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from rsenf.discrepancy.course import form_of
from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.hint import hint_json, hint_of
from rsenf.discrepancy.knobs import series_of
from rsenf.discrepancy.lines import along_rows
from rsenf.discrepancy.measured import Measured
from rsenf.discrepancy.search import Step
from rsenf.discrepancy.trial import Trial
from rsenf.discrepancy.verdict import Discovery, stamps_gap
from rsenf.model import CaptureModel, Effect
from rsenf.model.sensor import QUANTISATION_VAR, WHITE

MOST_EVENTS = 100  # that are listed
FEWEST_PIXELS, MOST_PIXELS = 16, 8192  # of a line
SURE = 3.0  # standard errors with which a place is one


def discovery_json(found: Discovery, model_out: str) -> dict[str, Any]:
    """Return the stable keys of what was found, plain values all."""
    first, last, floor = found.first.gap, found.last.gap, found.floor
    return {
        "version": 1,
        "verdict": found.verdict,
        "effects": [
            *([_stamps_json(found)] if found.stamps else []),
            *(_step_json(step) for step in found.steps),
        ],
        "gap": {
            "before": found.gap_before,
            "before_stderr": first.stderr,
            "after": found.gap_after,
            "stderr": last.stderr,
            "floor": floor.median,
            "limit": floor.limit,
            "codec": found.usual.gap,
            "shrinkage": found.shrinkage if found.shrinkage == found.shrinkage else None,
        },
        "held_out_mean_square": {"before": found.first.misfit, "after": found.last.misfit},
        "where_before": [dataclasses.asdict(share) for share in found.before],
        "unexplained": _left(found),
        "model_out": model_out,
    }


def model_of(found: Discovery, made_from: str) -> CaptureModel:
    """Return the extended model, with where it comes from and how sure its parameters are."""
    theory, data = found.last.theory, found.last.data
    errors = {
        ".".join([knob.part, knob.name, *([str(knob.index)] if knob.index >= 0 else []),
                  *(["across"] if knob.across else [])]): float(error)
        for knob, error in zip(found.last.knobs, found.last.stderr, strict=True)
    }  # fmt: skip
    provenance = {
        "made_by": "rsenf discover",
        "from": made_from,
        "verdict": found.verdict,
        "stderr": errors,
        "gap": {"before": found.gap_before, "after": found.gap_after},
        "wander": "the light's course is the recording's own and isn't part of the model",
    }
    extended = _of_rows(theory.whole(), data)
    shutter = dataclasses.replace(extended.shutter, columns=_columns(found.last))
    return dataclasses.replace(extended, shutter=shutter, provenance=provenance)


def _of_rows(model: CaptureModel, data: Measured) -> CaptureModel:
    """Return a model whose frames have as many rows as the recording's."""
    if data.group == 1:
        return model
    taken = data.rows / (data.lines * data.group)  # a few rows at the end may be left over
    shutter = dataclasses.replace(
        model.shutter,
        rows=data.rows,
        idle_ratio=max(1.0 - (1.0 - model.shutter.idle_ratio) * taken, 0.0),
    )

    def of_rows(values: Any) -> np.ndarray:
        return along_rows(np.array(values), data.group, data.rows, fields=data.fields, axis=0)

    profile = of_rows(model.scene.profile)
    profile *= np.repeat(data.texture, profile.shape[1] // data.strips, axis=1)
    profile = np.minimum(profile, WHITE)
    scene = dataclasses.replace(model.scene, profile=tuple(map(tuple, profile.tolist())))
    effects = []
    for effect in model.effects:
        told = series_of(effect)
        if told and told[1].each == "line":
            values = of_rows(getattr(effect, told[0]))
            effect = dataclasses.replace(effect, **{told[0]: tuple(values.tolist())})
        effects.append(effect)
    return dataclasses.replace(model, shutter=shutter, scene=scene, effects=tuple(effects))


def _columns(last: Fit) -> int:
    """How many pixels a line needs for its means to have as much noise as was measured.

    Whole halves of strips of them, as the wall is described.
    """
    wall, unit = last.theory.wall.astype(np.float32), 2 * last.data.strips
    pixel_var = float(last.theory.model.sensor.variance(wall).mean()) + QUANTISATION_VAR
    wanted = pixel_var / (last.noise_var * last.data.group) * last.data.strips
    return unit * min(max(round(wanted / unit), -(-FEWEST_PIXELS // unit)), MOST_PIXELS // unit)


def _stamps_json(found: Discovery) -> dict[str, Any]:
    stamps = found.stamps
    assert stamps is not None
    several = len(stamps.rivals) > 1
    return {
        "name": None if several else stamps.effect.name,
        "class": list(stamps.rivals) if several else [],
        "parameters": _numbers(stamps.effect),
        "stderr": {},
        "told_apart_by": stamps.effect.told_apart_by if several else "",
        "gap_before": found.gap_before,
        "gap_after": stamps.fit.gap.value,
        "gain": stamps.gap,
        "evidence": None,  # stamps have no noise
        "tried": len(stamps.rivals),
    }


def _numbers(effect: Effect) -> dict[str, Any]:
    """Parameters of an effect, without those that have a value for each frame or line."""
    told = effect.to_dict().items()
    return {k: v for k, v in told if not (isinstance(v, list) and len(v) > MOST_EVENTS)}


def _step_json(step: Step) -> dict[str, Any]:
    best = step.chosen
    assert best is not None
    kin = step.kin
    told = series_of(best.effect)
    return {
        "name": best.effect.name if len(kin) == 1 else None,
        "class": list(kin) if len(kin) > 1 else [],
        "parameters": {k: v for k, v in _numbers(best.effect).items() if not told or k != told[0]},
        "stderr": best.fit.stderr_of(best.effect.name),
        "told_apart_by": best.effect.told_apart_by if len(kin) > 1 else "",
        "gap_before": step.before.gap.value,
        "gap_after": best.fit.gap.value,
        "gain": best.gain,
        "evidence": best.nats,
        "tried": step.tried,
        **_course_json(best),
    }


def _course_json(best: Trial) -> dict[str, Any]:
    """Return the form of an effect's course, where it may take any."""
    effect, told = best.effect, series_of(best.effect)
    if told is None or not told[1].free:
        return {}
    course = getattr(effect, told[0] if told[1].each == "frame" else "course")
    rate_hz = float(best.fit.data.frame_rate)
    return {"course": form_of(np.arange(len(course)) / rate_hz, np.array(course))}


def _left(found: Discovery) -> dict[str, Any] | None:
    if found.verdict != "unexplained":
        return None
    places = [share for share in found.after if share.sure > SURE]
    return {
        "gap": found.gap_after,
        "stamps_gap": stamps_gap(found.last),
        "places": [dataclasses.asdict(share) for share in places],
        **hint_json(hint_of(found.last, found.after)),
    }
