"""Initial values of the first fit, from the ENF and idle period that the estimators find."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rsenf.discrepancy.fit import Fit, fit, mean_square
from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.forward_model import Course, ForwardModel
from rsenf.discrepancy.jacobian import jacobian_of
from rsenf.discrepancy.lines import averaged
from rsenf.discrepancy.measured import Measured
from rsenf.discrepancy.residual_features import features_of
from rsenf.discrepancy.series import held, with_series
from rsenf.errors import InputError, NoSignal, UsageError
from rsenf.match.series import track_of
from rsenf.model import CaptureModel, Effect, Light
from rsenf.model.effects import DeliveryEffect
from rsenf.model.parameters import fittings

# Initial model when none is given.
PLAIN = CaptureModel(name="plain", light=Light(lamp="tone"))
LEAST_USABLE = 0.5  # share of the seconds
FIRST_SIZE = 0.05  # flicker ratio of the first simulation


def first_fit(model: CaptureModel, data: Measured) -> Fit:
    """Make the first fit of a search.

    The tracker assumes that every captured frame is delivered. If the model has effects on
    delivery, a fit without them comes first, and the phase that it found is then split into jumps
    of time and the light's own course, as in a search that finds such an effect.

    Parameters
    ----------
    model : CaptureModel
        Initial model.
    data : Measured

    Raises
    ------
    InputError
        When no flicker can be tracked.
    """
    in_time = tuple(e for e in model.effects if not isinstance(e, DeliveryEffect))
    first = fit(first_theory(dataclasses.replace(model, effects=in_time), data), data)
    if len(in_time) == len(model.effects):
        return first
    whole = dataclasses.replace(first.forward.model, effects=model.effects)
    ahead_rad = features_of(first).angle_rad
    return fit(first.forward.otherwise_delivered(whole, data, ahead_rad), data)


def first_theory(model: CaptureModel, data: Measured) -> ForwardModel:
    """Return a forward model near enough to the data for a fit to converge.

    Parameters
    ----------
    model : CaptureModel
        Initial model. Its flicker ratio and, if the estimators found one, its idle ratio are
        replaced.
    data : Measured

    Raises
    ------
    InputError
        When no flicker can be tracked.
    UsageError
        When two effects have the same name.
    """
    if len({effect.name for effect in model.effects}) < len(model.effects):
        raise UsageError("two effects of one name can't be fitted", "leave one out")
    idle_ratio = data.estimates.idle_ratio
    known = math.isfinite(idle_ratio)
    shutter = dataclasses.replace(
        model.shutter,
        frame_rate=data.frame_rate,
        rows=data.lines,
        read_out="rows",  # whatever the model's own: data has lines
        # All columns of half a strip are equal, so the fewest possible will do.
        columns=max(16, 8 * data.strips),
        idle_ratio=min(max(idle_ratio, 0.0), 0.98) if known else model.shutter.idle_ratio,
    )
    light = dataclasses.replace(model.light, flicker_ratio=FIRST_SIZE)
    wall = np.asarray(data.level.mean(axis=0, dtype=np.float64))
    effects = tuple(_of_lines(effect, data) for effect in model.effects)
    begun = dataclasses.replace(model, light=light, shutter=shutter, effects=effects)
    forward = ForwardModel(begun, _course(data), wall, np.zeros_like(wall))
    for effect in effects:  # a series without values begins at zero
        if (series := series_of(effect)) and not getattr(effect, series[0]):
            values = held(forward, data, effect, *series)
            forward = with_series(forward, effect, series[0], values)
    return sized(forward, data)


def _of_lines(effect: Effect, data: Measured) -> Effect:
    """Average an effect's series of rows into lines."""
    for name, fitting in fittings(effect).items():  # phases that lack are 0
        if fitting.turn and fitting.most:
            ratios, phases = getattr(effect, name), getattr(effect, fitting.turn)
            phases = (*phases, *(0.0,) * (len(ratios) - len(phases)))
            effect = dataclasses.replace(effect, **{fitting.turn: phases})
    series = series_of(effect)
    if series is None or series[1].each != "line":
        return effect
    if len(getattr(effect, series[0])) != data.rows:
        kept = getattr(effect, series[0]) if len(getattr(effect, series[0])) == data.lines else ()
        return dataclasses.replace(effect, **{series[0]: kept})
    rows = np.array(getattr(effect, series[0]), np.float32)[None, :, None]
    lines = averaged(rows, data.group, data.fields)[0, :, 0]
    return dataclasses.replace(effect, **{series[0]: tuple(lines.tolist())})


def _course(data: Measured) -> Course:
    """Return the tracked phase course; where too few seconds have a phase, the integrated ENF."""
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


def sized(forward: ForwardModel, data: Measured) -> ForwardModel:
    """Estimate amplitude and phase of the flicker by one linear step."""
    rows = forward.rows(data)
    about = jacobian_of(forward, rows, data)
    flicker = rows - forward.wall.astype(np.float32)
    normal = about.training.plus([flicker, about.turn]).normal(data.level - rows + flicker)
    pair = slice(normal.course, None)
    along, across = np.linalg.solve(normal.matrix[pair, pair], normal.vector[pair])
    size, turned = math.hypot(along, across), math.atan2(across, along)
    light = forward.model.light
    ratio = (light.flicker_ratio or FIRST_SIZE) * size
    light = dataclasses.replace(light, flicker_ratio=min(max(ratio, 1e-4), 0.9))
    course = forward.course.through(forward.course.psi_rad + turned)
    model = dataclasses.replace(forward.model, light=light)
    return dataclasses.replace(forward, model=model, course=course)


def begun_anew(forward: ForwardModel, data: Measured) -> ForwardModel:
    """Estimate the flicker anew for a model with another order of read-out.

    Interlaced fields taken for one frame seem to be read twice as fast; both idle ratios are tried.
    """
    model, out = forward.model, []
    for times in (1.0, 2.0):
        idle_ratio = 1.0 - times * (1.0 - model.shutter.idle_ratio)
        if idle_ratio >= 0.0:
            shutter = dataclasses.replace(model.shutter, idle_ratio=idle_ratio)
            other = forward.with_model(dataclasses.replace(model, shutter=shutter))
            out.append(sized(other, data))
    return min(out, key=lambda t: misfit(t, data))


def misfit(forward: ForwardModel, data: Measured) -> float:
    """Mean square of a model's residual (levels²)."""
    return mean_square(data.level - forward.rows(data))
