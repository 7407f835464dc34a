"""A theory fitted to a recording: Gauss-Newton steps, every derivative made by the capture model.

What belongs to the camera and the lamp is fitted to the training frames; the course of the phase,
which every moment has of its own, to one row in two of all frames. So the other row of a frame that
nothing was trained on is a fair judge of both.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rsenf.discrepancy.gap import Gap, gap_of
from rsenf.discrepancy.knobs import FLICKER, IDLE, Knob, knobs_of, turned
from rsenf.discrepancy.linear import Directions
from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.discrepancy.series import improved
from rsenf.discrepancy.theory import Theory
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel

TURN_RAD, LIT = 0.02, 0.01
FARTHEST_RAD, FARTHEST_STEPS = 1.0, 50.0  # that one step may go
REST_RAD, REST_STEPS = 1e-4, 1e-2  # of the phase, and of a knob in its own steps
MOST = 8
DARKEST = 0.01  # level of a wall: none that no light could be relative to


@dataclass(frozen=True, eq=False)
class Fit:
    """A theory beside the data.

    Attributes
    ----------
    data : Measured
    begun : Theory
        From where it was fitted.
    theory : Theory
    rows : ndarray of float32 (frames, lines, strips)
        What it says.
    residual : ndarray of float32 (frames, lines, strips)
        Data less that.
    knobs : tuple of Knob
        What was fitted, besides the course and the wall.
    stderr : ndarray (knobs,)
        Standard error of each.
    """

    data: Measured
    begun: Theory
    theory: Theory
    rows: Float32Array
    residual: Float32Array
    knobs: tuple[Knob, ...]
    stderr: FloatArray

    @cached_property
    def flicker(self) -> Float32Array:
        """What is said less what would be without flicker."""
        model = self.theory.model
        unlit = dataclasses.replace(model.light, flicker_ratio=0.0)
        still = self.theory.with_model(dataclasses.replace(model, light=unlit)).rows(self.data)
        return self.rows - still

    @cached_property
    def noise_var(self) -> float:
        """Variance of a row's noise, in the training frames."""
        return noise_var(self.residual[self.data.training], self.data)

    @cached_property
    def gap(self) -> Gap:
        """Held-out gap."""
        return gap_of(self.residual, self.flicker, self.data, ~self.data.training)

    @cached_property
    def misfit(self) -> float:
        """Held-out mean square of the residual (levels²)."""
        return float((self.residual[~self.data.training] ** 2).mean(dtype=np.float64))

    @cached_property
    def directions(self) -> Directions:
        """What the rows do about this theory."""
        return directions_of(self.theory, self.data, self.rows)

    @cached_property
    def known(self) -> list[Float32Array]:
        """What the rows do when each knob is turned."""
        model = self.theory.model
        return [self.direction(knob.moved(model, knob.step), knob.step) for knob in self.knobs]

    def direction(self, model: CaptureModel, step: float) -> Float32Array:
        """What the rows do, per step, with another model."""
        moved = self.theory.with_model(model).rows(self.data)
        return np.asarray((moved - self.rows) / np.float32(step))


def directions_of(theory: Theory, data: Measured, rows: Float32Array) -> Directions:
    """Turn the light and brighten the wall, and see what that does."""
    turn = (theory.rows(data, turned_rad=TURN_RAD) - rows) / np.float32(TURN_RAD)
    lit = (theory.rows(data, lit=1.0 + LIT) - rows) / np.float32(LIT)
    middle_s = data.time_s + 0.5 * theory.model.shutter.read_out_time_s
    return Directions(lit, turn, theory.course.basis_at(middle_s))


def fit(theory: Theory, data: Measured, *, most: int = MOST) -> Fit:
    """Fit a theory, its effects included, from where it stands.

    Parameters
    ----------
    theory : Theory
        Near enough for steps to lead to it: half a turn of the phase, half a knob.
    data : Measured
    most : int, optional
        Steps.
    """
    knobs = [FLICKER, IDLE]
    for effect in theory.model.effects:
        knobs += knobs_of(effect, neutral=False)
    begun, rows, stderr = theory, theory.rows(data), np.full(len(knobs), np.nan)
    for _ in range(most):
        theory, rows, stderr, moved = _stepped(theory, rows, data, knobs)
        if moved < 1.0:
            break
    return Fit(data, begun, theory, rows, data.level - rows, tuple(knobs), stderr)


def noise_var(residual: Float32Array, data: Measured) -> float:
    """Variance of a row's noise: of what neighbours don't share."""
    return float(np.var(np.diff(residual, axis=data.apart), dtype=np.float64) / 2.0)


def _stepped(
    theory: Theory, rows: Float32Array, data: Measured, knobs: Sequence[Knob]
) -> tuple[Theory, Float32Array, FloatArray, float]:
    """Take one step: knobs, then the course given these, then series, then the wall.

    Also what the theory says then, the knobs' standard errors, and how far it went: below one it
    is at rest.
    """
    about, residual = directions_of(theory, data, rows), data.level - rows
    variance, weights = noise_var(residual[data.training], data), theory.course.weights
    own = [
        (theory.with_model(k.moved(theory.model, k.step)).rows(data) - rows) / np.float32(k.step)
        for k in knobs
    ]
    normal = about.normal(residual, own, data.training).over(variance).with_prior(weights)
    stderr = np.sqrt(np.diag(normal.covariance())[normal.course :])
    steps = np.array([abs(knob.step) for knob in knobs])
    step = np.clip(normal.solve()[normal.course :], -FARTHEST_STEPS * steps, FARTHEST_STEPS * steps)
    # The course by one half of each frame, given the rest.
    rest = residual - sum(s.astype(np.float32) * d for s, d in zip(step, own, strict=True))
    alone = about.normal(rest, [], np.ones(data.frames, bool), data.first).over(variance)
    course = alone.with_prior(weights).solve()
    farthest = float(np.abs(about.basis @ course).max())
    theory = Theory(
        turned(theory.model, knobs, step.tolist()),
        theory.course.moved(course * min(1.0, FARTHEST_RAD / max(farthest, 1e-9))),
        theory.wall,
    )
    theory = improved(theory, theory.rows(data), about.lit, data)
    theory, rows = _relit(theory, about, data)
    return theory, rows, stderr, max(farthest / REST_RAD, *(np.abs(step) / steps / REST_STEPS))


def _relit(theory: Theory, about: Directions, data: Measured) -> tuple[Theory, Float32Array]:
    """Move the wall to where the training frames have it."""
    rows = theory.rows(data)
    brighter = about.brighter(data.level - rows, data.training)
    wall = np.clip(theory.wall * (1.0 + brighter), DARKEST, 255.0)
    theory = Theory(theory.model, theory.course, wall)
    return theory, theory.rows(data)
