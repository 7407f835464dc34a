"""A theory fitted to a recording: Gauss-Newton steps, every derivative made by the capture model.

What belongs to the camera and the lamp is fitted to the training frames; the course of the phase,
which every moment has of its own, to one row in two of all frames. So the other row of a frame that
nothing was trained on is a fair judge of both.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from typing import cast

import numpy as np

from rsenf.discrepancy.fit_parameters import FLICKER, IDLE, FitParameter, knobs_of, turned
from rsenf.discrepancy.forward_model import ForwardModel
from rsenf.discrepancy.gap import Gap, gap_of
from rsenf.discrepancy.jacobian import Jacobian, slopes_of
from rsenf.discrepancy.measured import BANDS, Float32Array, Measured
from rsenf.discrepancy.series import improved
from rsenf.discrepancy.strip_centroid import USUAL, as_walls_may, leaned, leans
from rsenf.messages.schema import FloatArray

FARTHEST_RAD, FARTHEST_STEPS = 1.0, 50.0  # that one step may go
# Farther than this, of the phase and of a knob or a value in its own steps, slopes are others.
NEAR_RAD, NEAR_STEPS = 0.03, 1.0
# Values of a series follow the noise of their own frames: nearer isn't worth the way.
REST_RAD, REST_STEPS, REST_SERIES = 1e-4, 1e-2, 0.1
MOST = 8
ASTRAY = 1.05  # of the least mean square on the way, that may be left

DARKEST = 0.01  # level of a wall: none that no light could be relative to


@dataclass(frozen=True, eq=False)
class Fit:
    """A theory beside the data.

    Attributes
    ----------
    data : Measured
    begun : ForwardModel
        From where it was fitted.
    theory : ForwardModel
    rows : ndarray of float32 (frames, lines, strips)
        What it says.
    residual : ndarray of float32 (frames, lines, strips)
        Data less that.
    slopes : Jacobian
        What the rows do about it.
    stderr : ndarray (knobs,)
        Standard error of each knob.
    """

    data: Measured
    begun: ForwardModel
    theory: ForwardModel
    rows: Float32Array
    residual: Float32Array
    slopes: Jacobian
    stderr: FloatArray

    @property
    def knobs(self) -> tuple[FitParameter, ...]:
        """What was fitted, besides the course and the wall."""
        return self.slopes.knobs

    def released(self, *, rows: bool = False) -> Fit:
        """Return what is known of it, without the arrays; or with the rows it says and leaves."""
        out = dataclasses.replace(self, slopes=self.slopes.released())
        if not rows:
            none = np.empty((0, 0, 0), np.float32)
            out = dataclasses.replace(out, rows=none, residual=none)
        out.__dict__.update(gap=self.gap, misfit=self.misfit, noise_var=self.noise_var)
        return out

    def restored(self) -> Fit:
        """Return it with all of its arrays, if they were let go."""
        if self.slopes.lit.size:
            return self
        rows = self.rows if self.rows.size else self.theory.rows(self.data)
        slopes = slopes_of(self.theory, rows, self.data, self.knobs)
        left = self.data.level - rows
        return dataclasses.replace(self, rows=rows, residual=left, slopes=slopes)

    def stderr_of(self, part: str) -> dict[str, float | list[float]]:
        """Standard errors of a part's parameters, by name; of a list those of its members."""
        out: dict[str, float | list[float]] = {}
        for knob, error in zip(self.knobs, self.stderr.tolist(), strict=True):
            if knob.part != part or knob.across:
                continue
            if knob.index < 0:
                out[knob.name] = error
            else:
                out[knob.name] = [*cast("list[float]", out.get(knob.name, [])), error]
        return out

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


def fit(
    theory: ForwardModel, data: Measured, *, most: int = MOST, slopes: Jacobian | None = None
) -> Fit:
    """Fit a theory, its effects included, from where it stands.

    Parameters
    ----------
    theory : ForwardModel
        Near enough for steps to lead to it: half a turn of the phase, half a knob.
    data : Measured
    most : int, optional
        Steps.
    slopes : Jacobian, optional
        About where it stands, if they are known: the first step needs no others.
    """
    knobs = [FLICKER, IDLE]
    for effect in theory.model.effects:
        knobs += knobs_of(effect, neutral=False)
    begun, rows = theory, theory.rows(data)
    nearest = mean_square(data.level - rows), theory
    for _ in range(most):
        if slopes is None:
            slopes = slopes_of(theory, rows, data, knobs)
        step = _stepped(theory, rows, slopes)
        theory, rows = step.theory, step.rows
        nearest = min(nearest, (mean_square(data.level - rows), theory), key=itemgetter(0))
        complete = len(slopes.knobs) == len(knobs) and (slopes.lean is not None) == leans(theory)
        if step.rested and complete:
            break
        if step.far or not complete:
            slopes = None
    else:
        slopes = slopes or slopes_of(theory, rows, data, knobs)
    left = data.level - rows
    least, nearest_theory = nearest
    if mean_square(left) > ASTRAY * least:  # steps have led away
        theory = nearest_theory
        rows = theory.rows(data)
        slopes, left = slopes_of(theory, rows, data, slopes.knobs), data.level - rows
    return Fit(data, begun, theory, rows, left, slopes, _stderr(slopes, left))


def noise_var(residual: Float32Array, data: Measured) -> float:
    """Variance of a row's noise: of what neighbours don't share, nor those one further on.

    What goes up and down from row to row is no noise either, nor what grows from one to the next.
    """
    moved = np.moveaxis(residual, data.apart, 0)
    apart = [(moved[n:] - moved[:-n], 2.0) for n in (1, 2) if len(moved) > n]
    if len(moved) > 2:
        apart.append((moved[2:] - 2.0 * moved[1:-1] + moved[:-2], 6.0))
    return min(float(np.var(of, dtype=np.float64)) / times for of, times in apart)


def mean_square(left: Float32Array) -> float:
    """Of what is left (levels²)."""
    return float(np.vdot(left, left)) / left.size


@dataclass(frozen=True, eq=False)
class _Step:
    """Where a step has led: what the theory is and says then, and how far it went."""

    theory: ForwardModel
    rows: Float32Array
    turned_rad: float
    turned_steps: float
    moved_steps: float  # of a series

    @property
    def far(self) -> bool:
        return (
            self.turned_rad > NEAR_RAD
            or self.turned_steps > NEAR_STEPS
            or self.moved_steps > NEAR_STEPS
        )

    @property
    def rested(self) -> bool:
        return (
            self.turned_rad < REST_RAD
            and self.turned_steps < REST_STEPS
            and self.moved_steps < REST_SERIES
        )


def _stepped(theory: ForwardModel, rows: Float32Array, slopes: Jacobian) -> _Step:
    """Take one step: knobs, then the course given these, then series, then the wall."""
    data, knobs = slopes.data, slopes.knobs
    left = data.level - rows
    variance, weights = noise_var(left[data.training], data), theory.course.weights
    normal = slopes.training.normal(left).over(variance).with_prior(weights)
    steps = np.array([abs(knob.step) for knob in knobs])
    step = np.clip(normal.solve()[normal.course :], -FARTHEST_STEPS * steps, FARTHEST_STEPS * steps)
    for size, direction in zip(step.astype(np.float32), slopes.own, strict=True):
        left -= size * direction
    course = slopes.course.normal(left).over(variance).with_prior(weights).solve()
    farthest_rad = float(np.abs(slopes.basis @ course).max())
    course *= min(1.0, FARTHEST_RAD / max(farthest_rad, 1e-9))
    left -= (slopes.basis @ course).astype(np.float32)[:, None, None] * slopes.turn
    model = turned(theory.model, knobs, step.tolist())
    theory = dataclasses.replace(theory, model=model, course=theory.course.moved(course))
    theory, left, moved_steps = improved(theory, left, slopes.lit, slopes.series, data)
    if slopes.lean is not None:
        theory, left = leaned(theory, left, slopes.lean, data, variance)
    wall = np.clip(theory.wall * (1.0 + slopes.brighter(left)), DARKEST, 255.0)
    theory = dataclasses.replace(theory, wall=wall)
    turned_steps = float((np.abs(step) / steps).max())
    return _Step(theory, theory.rows(data), farthest_rad, turned_steps, moved_steps)


def _stderr(slopes: Jacobian, left: Float32Array) -> FloatArray:
    """Return the standard errors of the knobs.

    By the noise of rows, or by how much blocks of time, or bands of lines, disagree if that is
    more; where it matters, strips may lean as walls do.
    """
    data, system = slopes.data, slopes.training
    variance = noise_var(left[data.training], data)
    normal = system.matrix.over(variance)
    normal = normal.with_prior(np.zeros(normal.course))
    found = [normal.covariance()]
    if may := as_walls_may(slopes.lean) if slopes.lean is not None else []:
        whole = system.plus(may).matrix.over(variance)
        found.append(whole.with_prior(np.zeros(whole.course)).considering(len(may), USUAL))
    by_frame, by_value = system.scores(left)
    block = data.block[data.training]
    by_line = by_value.reshape(data.lines, data.strips, -1).sum(axis=1)
    for clusters in (
        [by_frame[block == number] for number in np.unique(block)],
        np.array_split(by_line, min(BANDS, data.lines)),
    ):
        if len(clusters) > 1:
            found.append(normal.sandwich(np.array([c.sum(axis=0) for c in clusters]) / variance))
    most = np.max([np.diag(covariance) for covariance in found], axis=0)
    return np.asarray(np.sqrt(np.maximum(most, 0.0))[normal.course :])
