"""Where the first fit begins: course and idle period as the estimators of rsenf see them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from rsenf.discrepancy.fit import directions_of
from rsenf.discrepancy.measured import Measured
from rsenf.discrepancy.theory import Course, Theory
from rsenf.errors import InputError
from rsenf.match.series import track_of
from rsenf.messages import EnfEstimate
from rsenf.model import CaptureModel, Light

# What to begin with when nothing is known.
PLAIN = CaptureModel(name="plain", light=Light(lamp="tone"))
LEAST_USABLE = 0.5  # share of the seconds
FIRST_SIZE = 0.05  # flicker with which the first simulation is made


def first_theory(
    model: CaptureModel, data: Measured, estimates: Sequence[EnfEstimate], idle_ratio: float
) -> Theory:
    """Return a theory near enough to the data for a fit to find its way.

    Parameters
    ----------
    model : CaptureModel
        What to begin with; of it, the size of the flicker and the idle period are replaced.
    data : Measured
    estimates : sequence of EnfEstimate
        Of the same rows, by an estimator that publishes amplitudes if there is one.
    idle_ratio : float
        As it was estimated; NaN for unknown, and the model's is taken.

    Raises
    ------
    InputError
        When no flicker can be followed.
    """
    known = math.isfinite(idle_ratio)
    shutter = dataclasses.replace(
        model.shutter,
        frame_rate=data.frame_rate,
        rows=data.lines,
        # The scene's columns are all of one strip: as few as there may be.
        columns=max(16, data.strips),
        idle_ratio=min(max(idle_ratio, 0.0), 0.98) if known else model.shutter.idle_ratio,
    )
    light = dataclasses.replace(model.light, flicker_ratio=FIRST_SIZE)
    wall = np.asarray(data.level.mean(axis=0, dtype=np.float64))
    begun = dataclasses.replace(model, light=light, shutter=shutter)
    return sized(Theory(begun, _course(data, estimates), wall), data)


def _course(data: Measured, estimates: Sequence[EnfEstimate]) -> Course:
    """Follow the phase: as measured each second where it could be, by the frequency elsewhere."""
    if not estimates:
        raise InputError("no ENF estimate: the recording is too short", "give a longer one")
    track = track_of(estimates)
    if track.usable < LEAST_USABLE * track.enf_hz.size:
        reason = next((e.reason for e in estimates if not e.usable), "")
        raise InputError(f"no flicker to fit a model to: {reason}", "film under mains light")
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


def sized(theory: Theory, data: Measured) -> Theory:
    """Give the light its size and its phase by one linear step."""
    rows = theory.rows(data)
    about = directions_of(theory, data, rows)
    flicker = rows - theory.wall.astype(np.float32)
    normal = about.normal(data.level - rows + flicker, [flicker, about.turn], data.training)
    own = slice(normal.course, None)
    along, across = np.linalg.solve(normal.matrix[own, own], normal.vector[own])
    size, turned = math.hypot(along, across), math.atan2(across, along)
    light = theory.model.light
    ratio = (light.flicker_ratio or FIRST_SIZE) * size
    light = dataclasses.replace(light, flicker_ratio=min(max(ratio, 1e-4), 0.9))
    course = theory.course.through(theory.course.psi_rad + turned)
    return Theory(dataclasses.replace(theory.model, light=light), course, theory.wall)
