"""Presents a discovery as plain values and as a model file, and names the form of fitted courses.

The form of a course over time is the first of: even (linear), exponential, periodic, in steps, that
leaves little of its variance; otherwise it is a random walk, described as an Ornstein-Uhlenbeck
process.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from rsenf.discrepancy.effect_file import file_of, source_of
from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.forward_selection import Step
from rsenf.discrepancy.grammar import size_of, term_of, words_of
from rsenf.discrepancy.lines import along_rows
from rsenf.discrepancy.measured import Measured
from rsenf.discrepancy.residual_classifier import hint_json, hint_of
from rsenf.discrepancy.series import best_step
from rsenf.discrepancy.trial import Trial
from rsenf.discrepancy.verdict import Discovery, stamps_gap
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel, Effect
from rsenf.model.noise import QUANTISATION_VAR, WHITE

LEAVES = 0.1  # largest share of the variance that a form may leave
MOST_STEPS = 12
LAG_S = 0.5  # lag of a walk's autocovariance
Fitted = tuple[FloatArray, dict[str, Any]]
MOST_EVENTS = 100  # longest list in a result
FEWEST_PIXELS, MOST_PIXELS = 16, 8192  # of a line
SURE = 3.0  # standard errors from which on a share is reported


def form_of(t_s: FloatArray, values: FloatArray) -> dict[str, Any]:
    """Name the form of a course.

    Parameters
    ----------
    t_s : ndarray (values,)
        Rising, about equidistant.
    values : ndarray (values,)

    Returns
    -------
    dict
        ``form`` and its parameters; ``leaves``, the share of the variance that the form leaves,
        noise (from the differences of successive values) subtracted; for a walk ``rms`` and
        ``time_constant_s``.

    Examples
    --------
    >>> t_s = np.arange(100.0)
    >>> form_of(t_s, 0.5 * t_s)["form"]
    'even'
    """
    away = values - values.mean()
    noise = 0.5 * float(np.mean(np.diff(away) ** 2))
    power = max(float(np.mean(away**2)) - noise, 1e-30)
    for form in (_even, _exponential, _periodic, _steps):
        fitted, parameters = form(t_s - t_s[0], away)
        leaves = max(float(np.mean((away - fitted) ** 2)) - noise, 0.0) / power
        if leaves < LEAVES:
            return {"form": form.__name__[1:], **parameters, "leaves": leaves}
    rms, time_constant_s = float(np.sqrt(power)), _forgets_in_s(t_s, away)
    return {"form": "random walk", "rms": rms, "time_constant_s": time_constant_s}


def _forgets_in_s(t_s: FloatArray, away: FloatArray) -> float:
    """Time constant of a walk, from its autocovariance at two lags, where white noise has none."""
    step_s = float(np.median(np.diff(t_s)))
    lag = max(round(LAG_S / step_s), 1)
    near, far = (float(away[n:] @ away[:-n]) / (away.size - n) for n in (lag, 2 * lag))
    stays = min(max(far / max(near, 1e-30), 1e-6), 1.0 - 1e-6)
    return -lag * step_s / float(np.log(stays))


def _least_squares(values: FloatArray, *shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    matrix = np.column_stack([np.ones(values.size), *shapes])
    weights = np.linalg.lstsq(matrix, values, rcond=None)[0]
    return np.asarray(matrix @ weights), np.asarray(weights)


def _even(t_s: FloatArray, values: FloatArray) -> Fitted:
    fitted, weights = _least_squares(values, t_s)
    return fitted, {"rise_per_min": 60.0 * float(weights[1])}


def _exponential(t_s: FloatArray, values: FloatArray) -> Fitted:
    """Try time constants from a thirtieth of the duration to three times the duration."""
    tries = []
    for constant_s in float(t_s[-1]) * np.geomspace(1 / 30, 3.0, 60):
        fitted, weights = _least_squares(values, np.exp(-t_s / constant_s))
        residual_power = float(np.sum((values - fitted) ** 2))
        tries.append((residual_power, constant_s, fitted, float(weights[1])))
    _, constant_s, fitted, size = min(tries, key=lambda one: one[0])
    return fitted, {"time_constant_s": float(constant_s), "size": size}


def _periodic(t_s: FloatArray, values: FloatArray) -> Fitted:
    """Fit a tone and its second harmonic at the peak of the periodogram."""
    step_s = float(t_s[-1]) / (t_s.size - 1)
    power = np.abs(np.fft.rfft(values, 8 * values.size)) ** 2
    freq_hz = np.fft.rfftfreq(8 * values.size, step_s)
    first = 4  # half a period within the course, at least
    peak = first + int(np.argmax(power[first:]))
    angle = 2.0 * np.pi * freq_hz[peak] * t_s
    shapes = [wave(k * angle) for k in (1, 2) for wave in (np.cos, np.sin)]
    fitted, weights = _least_squares(values, *shapes)
    return fitted, {"freq_hz": float(freq_hz[peak]), "size": float(np.hypot(*weights[1:3]))}


def _steps(t_s: FloatArray, values: FloatArray) -> Fitted:
    """Fit steps by binary segmentation."""
    edges = [0, values.size]
    while len(edges) < MOST_STEPS + 2:
        parts = [(values[a:b] - values[a:b].mean(), a) for a, b in pairwise(edges)]
        cuts = ((best_step(p, p) if p.size >= 4 else (0.0, 0), a) for p, a in parts)
        (gain, at), begin = max(cuts)
        if gain < 0.01 * float(np.sum(values**2)):
            break
        edges = sorted([*edges, begin + at])
    fitted = np.concatenate([
        np.full(b - a, values[a:b].mean()) for a, b in pairwise(edges)
    ])  # fmt: skip
    return fitted, {"at_s": [float(t_s[n]) for n in edges[1:-1]]}


def sha256_of(text: str) -> str:
    """Return the hash of a text, as hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()


def discovery_json(
    found: Discovery, model_out: str, files: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Return a discovery as plain values with stable keys.

    Parameters
    ----------
    found : Discovery
    model_out : str
        Path of the extended model file.
    files : mapping of str, optional
        Effect files written beside it, of which the result keeps the hashes.
    """
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
            "codec": found.baseline.gap,
            "shrinkage": found.shrinkage if found.shrinkage == found.shrinkage else None,
        },
        "held_out_mean_square": {"before": found.first.misfit, "after": found.last.misfit},
        "where_before": [dataclasses.asdict(share) for share in found.before],
        "unexplained": _unexplained(found),
        "model_out": model_out,
        "files": {name: sha256_of(text) for name, text in (files or {}).items()},
    }


def model_of(found: Discovery, made_from: str) -> CaptureModel:
    """Return the extended model, with its provenance and the standard errors of its parameters.

    Parameters
    ----------
    found : Discovery
    made_from : str
        Name of the recording, for the provenance.
    """
    forward, data = found.last.forward, found.last.data
    errors = {
        ".".join([
            parameter.part, parameter.name,
            *([str(parameter.index)] if parameter.index >= 0 else []),
            *(["across"] if parameter.across else []),
        ]): float(error)
        for parameter, error in zip(found.last.parameters, found.last.stderr, strict=True)
    }  # fmt: skip
    provenance = {
        "made_by": "rsenf discover",
        "from": made_from,
        "verdict": found.verdict,
        "stderr": errors,
        "gap": {"before": found.gap_before, "after": found.gap_after},
        "wander": "the light's course is the recording's own and isn't part of the model",
    }
    extended = _of_rows(forward.whole(), data)
    shutter = dataclasses.replace(extended.shutter, columns=_columns(found.last))
    return dataclasses.replace(extended, shutter=shutter, provenance=provenance)


def _of_rows(model: CaptureModel, data: Measured) -> CaptureModel:
    """Expand a model of lines to the recording's rows."""
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
        series = series_of(effect)
        if series and series[1].each == "line":
            values = of_rows(getattr(effect, series[0]))
            effect = dataclasses.replace(effect, **{series[0]: tuple(values.tolist())})
        effects.append(effect)
    return dataclasses.replace(model, shutter=shutter, scene=scene, effects=tuple(effects))


def _columns(last: Fit) -> int:
    """Pixels of a line for which the simulated noise of row means equals the measured one."""
    wall, unit = last.forward.wall.astype(np.float32), 2 * last.data.strips  # in half strips
    pixel_var = float(last.forward.model.sensor.variance(wall).mean()) + QUANTISATION_VAR
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
        "evidence": None,  # time stamps have no noise
        "tried": len(stamps.rivals),
    }


def _numbers(effect: Effect) -> dict[str, Any]:
    """Parameters of an effect without values for each frame or line."""
    items = effect.to_dict().items()
    return {k: v for k, v in items if not (isinstance(v, list) and len(v) > MOST_EVENTS)}


def _step_json(step: Step) -> dict[str, Any]:
    best = step.chosen
    assert best is not None
    equivalents = step.equivalents
    spec = series_of(best.effect)
    return {
        "name": best.effect.name if len(equivalents) == 1 else None,
        "class": list(equivalents) if len(equivalents) > 1 else [],
        "parameters": {k: v for k, v in _numbers(best.effect).items() if not spec or k != spec[0]},
        "stderr": best.fit.stderr_of(best.effect.name),
        "told_apart_by": best.effect.told_apart_by if len(equivalents) > 1 else "",
        "gap_before": step.before.gap.value,
        "gap_after": best.fit.gap.value,
        "gain": best.gain,
        "evidence": best.nats,
        "tried": step.scored,
        **_course_json(best),
        **_term_json(best),
    }


def _term_json(best: Trial) -> dict[str, Any]:
    """Return the words and the file of an effect that no catalogue has."""
    if term_of(best.effect) is None:
        return {}
    words = words_of(best.effect, float(best.fit.data.frame_rate))
    return {"words": words, "size": size_of(best.effect), "file": file_of(best.effect)}


def files_of(found: Discovery, made_from: str) -> dict[str, str]:
    """Return the effect files of what no catalogue has, by file name.

    Parameters
    ----------
    found : Discovery
    made_from : str
        Name of the recording.
    """
    equivalents = {step.chosen.effect.name: step.equivalents for step in found.steps if step.chosen}
    rate_hz = float(found.last.data.frame_rate)
    return {
        file_of(effect): source_of(
            effect, found.last.stderr_of(effect.name), made_from, equivalents[effect.name], rate_hz
        )
        for effect in model_of(found, made_from).effects
        if term_of(effect) is not None
    }


def _course_json(best: Trial) -> dict[str, Any]:
    """Return the form of an effect's course, if it may have any; a term's words tell its form."""
    effect, series = best.effect, series_of(best.effect)
    if series is None or not series[1].free or term_of(effect) is not None:
        return {}
    course = getattr(effect, series[0] if series[1].each == "frame" else "course", ())
    if not course:  # of an effect file made here
        return {}
    rate_hz = float(best.fit.data.frame_rate)
    return {"course": form_of(np.arange(len(course)) / rate_hz, np.array(course))}


def _unexplained(found: Discovery) -> dict[str, Any] | None:
    if found.verdict != "unexplained":
        return None
    places = [share for share in found.after if share.sure > SURE]
    return {
        "gap": found.gap_after,
        "stamps_gap": stamps_gap(found.last),
        "places": [dataclasses.asdict(share) for share in places],
        **hint_json(hint_of(found.last, found.after)),
    }
