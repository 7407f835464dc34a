"""Where the first fit begins: course and idle period as the estimators of rsenf see them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rsenf.discrepancy.fit import Fit, fit, mean_square
from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.forward_model import Course, ForwardModel
from rsenf.discrepancy.jacobian import slopes_of
from rsenf.discrepancy.lines import averaged
from rsenf.discrepancy.measured import Measured
from rsenf.discrepancy.residue import residue_of
from rsenf.errors import InputError, NoSignal
from rsenf.match.series import track_of
from rsenf.model import CaptureModel, Effect, Light
from rsenf.model.effects import DeliveryEffect

# What to begin with when nothing is known.
PLAIN = CaptureModel(name="plain", light=Light(lamp="tone"))
LEAST_USABLE = 0.5  # share of the seconds
FIRST_SIZE = 0.05  # flicker with which the first simulation is made


def first_fit(model: CaptureModel, data: Measured) -> Fit:
    """Fit what a search begins with.

    The tracker knows nothing of frames that aren't delivered as they were taken: where the model
    does, what it has followed is first taken apart into leaps of time and the light's own course,
    as the search itself does when it finds such an effect.

    Parameters
    ----------
    model : CaptureModel
        What to begin with.
    data : Measured

    Raises
    ------
    InputError
        When no flicker can be followed.
    """
    in_time = tuple(e for e in model.effects if not isinstance(e, DeliveryEffect))
    first = fit(first_theory(dataclasses.replace(model, effects=in_time), data), data)
    if len(in_time) == len(model.effects):
        return first
    whole = dataclasses.replace(first.theory.model, effects=model.effects)
    ahead_rad = residue_of(first).angle_rad
    return fit(first.theory.otherwise_delivered(whole, data, ahead_rad), data)


def first_theory(model: CaptureModel, data: Measured) -> ForwardModel:
    """Return a theory near enough to the data for a fit to find its way.

    Parameters
    ----------
    model : CaptureModel
        What to begin with; the size of its flicker and, where it is seen, its idle period are
        replaced.
    data : Measured

    Raises
    ------
    InputError
        When no flicker can be followed.
    """
    idle_ratio = data.estimates.idle_ratio
    known = math.isfinite(idle_ratio)
    shutter = dataclasses.replace(
        model.shutter,
        frame_rate=data.frame_rate,
        rows=data.lines,
        # The columns of half a strip are all alike: as few as there may be.
        columns=max(16, 8 * data.strips),
        idle_ratio=min(max(idle_ratio, 0.0), 0.98) if known else model.shutter.idle_ratio,
    )
    light = dataclasses.replace(model.light, flicker_ratio=FIRST_SIZE)
    wall = np.asarray(data.level.mean(axis=0, dtype=np.float64))
    effects = tuple(_of_lines(effect, data) for effect in model.effects)
    begun = dataclasses.replace(model, light=light, shutter=shutter, effects=effects)
    return sized(ForwardModel(begun, _course(data), wall, np.zeros_like(wall)), data)


def _of_lines(effect: Effect, data: Measured) -> Effect:
    """Average what an effect has for each of the recording's rows, as they are averaged."""
    told = series_of(effect)
    if told is None or told[1].each != "line" or len(getattr(effect, told[0])) != data.rows:
        return effect
    rows = np.array(getattr(effect, told[0]), np.float32)[None, :, None]
    lines = averaged(rows, data.group, data.fields)[0, :, 0]
    return dataclasses.replace(effect, **{told[0]: tuple(lines.tolist())})


def _course(data: Measured) -> Course:
    """Follow the phase: as measured each second where it could be, by the frequency elsewhere."""
    estimates = data.estimates.enf
    if not estimates:
        raise InputError("no ENF estimate: the recording is too short", "give a longer one")
    track = track_of(estimates)
    if track.usable < LEAST_USABLE * track.enf_hz.size:
        reason = next((e.reason for e in estimates if not e.usable), "")
        raise NoSignal(f"no flicker to fit a model to: {reason}", "film under mains light")
    t_s = track.first_s + track.hop_s * np.arange(track.enf_hz.size)
    known = np.isfinite(track.enf_hz)
    away_hz = np.interp(t_s, t_s[known], track.enf_hz[known] - track.nominal_hz)
    steps = 2.0 * math.pi * track.hop_s * (away_hz[1:] + away_hz[:-1])
    walked = np.concatenate([[0.0], np.cumsum(steps)])
    course = Course.for_time(float(data.time_s[-1]) + 1.0, data.nominal_hz)
    measured = np.isfinite(track.phase_rad)
    if measured.sum() > LEAST_USABLE * measured.size:
        away = np.unwrap(track.phase_rad[measured] - walked[measured])
        walked = walked + np.interp(t_s, t_s[measured], away)
    node_s = course.node_s
    psi = np.interp(node_s, t_s, walked)
    psi += 4.0 * math.pi * away_hz[0] * np.minimum(node_s - t_s[0], 0.0)
    psi += 4.0 * math.pi * away_hz[-1] * np.maximum(node_s - t_s[-1], 0.0)
    return course.through(psi)


def sized(theory: ForwardModel, data: Measured) -> ForwardModel:
    """Give the light its size and its phase by one linear step."""
    rows = theory.rows(data)
    about = slopes_of(theory, rows, data)
    flicker = rows - theory.wall.astype(np.float32)
    normal = about.training.plus([flicker, about.turn]).normal(data.level - rows + flicker)
    own = slice(normal.course, None)
    along, across = np.linalg.solve(normal.matrix[own, own], normal.vector[own])
    size, turned = math.hypot(along, across), math.atan2(across, along)
    light = theory.model.light
    ratio = (light.flicker_ratio or FIRST_SIZE) * size
    light = dataclasses.replace(light, flicker_ratio=min(max(ratio, 1e-4), 0.9))
    course = theory.course.through(theory.course.psi_rad + turned)
    model = dataclasses.replace(theory.model, light=light)
    return dataclasses.replace(theory, model=model, course=course)


def begun_anew(theory: ForwardModel, data: Measured) -> ForwardModel:
    """Size the light of a theory whose lines are read in another order than was thought.

    Where two fields were taken for one frame, it seemed to be read twice as fast as it was.
    """
    model, out = theory.model, []
    for times in (1.0, 2.0):
        idle_ratio = 1.0 - times * (1.0 - model.shutter.idle_ratio)
        if idle_ratio >= 0.0:
            shutter = dataclasses.replace(model.shutter, idle_ratio=idle_ratio)
            other = theory.with_model(dataclasses.replace(model, shutter=shutter))
            out.append(sized(other, data))
    return min(out, key=lambda t: misfit(t, data))


def misfit(theory: ForwardModel, data: Measured) -> float:
    """Mean square of what a theory leaves (levels²)."""
    return mean_square(data.level - theory.rows(data))
