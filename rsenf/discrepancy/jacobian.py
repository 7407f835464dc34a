"""Jacobian of the rows with respect to a forward model's parameters, by finite differences."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rsenf.discrepancy.fit_parameters import FitParameter, series_of
from rsenf.discrepancy.forward_model import ForwardModel
from rsenf.discrepancy.linear import TINY, System
from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.discrepancy.series import response
from rsenf.discrepancy.strip_centroid import by_lean, leans
from rsenf.messages.schema import FloatArray

TURN_RAD, LIT = 0.02, 0.01


@dataclass(frozen=True, eq=False)
class Jacobian:
    """Derivatives of the rows at one forward model, (frames, lines, strips) each.

    Attributes
    ----------
    data : Measured
    basis : ndarray (frames, directions)
        Phase per unit weight of the course's directions, in each frame.
    lit : ndarray of float32
        By a relative change of the wall's level.
    turn : ndarray of float32
        By the light's phase (1/rad).
    knobs : tuple of FitParameter
    grads : tuple of ndarray of float32
        By each of these parameters.
    series : dict of str to ndarray of float32
        By effect that has a series: by all of its values at once.
    lean : ndarray of float32 or None
        By the strips' asymmetry; None if no light varies along the lines.
    """

    data: Measured
    basis: FloatArray
    lit: Float32Array
    turn: Float32Array
    knobs: tuple[FitParameter, ...]
    grads: tuple[Float32Array, ...]
    series: dict[str, Float32Array]
    lean: Float32Array | None = None

    @cached_property
    def training(self) -> System:
        """Normal equations of course and parameters on the training frames."""
        frames = self.data.training
        return System(self.lit, self.turn, self.basis[frames], lambda a: a[frames]).plus(self.grads)

    @cached_property
    def course(self) -> System:
        """Normal equations of the course on the first half of every frame."""
        first = self.data.first  # the lambda must not hold self, whose arrays it would keep alive
        return System(self.lit, self.turn, self.basis, lambda a: a[first])

    def plus(self, knobs: Sequence[FitParameter], grads: Sequence[Float32Array]) -> Jacobian:
        """Return the Jacobian extended by more parameters and the derivatives by them."""
        out = dataclasses.replace(self, knobs=(*self.knobs, *knobs), grads=(*self.grads, *grads))
        # Keep the cached normal equations.
        out.__dict__["training"] = self.training.plus(grads)
        out.__dict__["course"] = self.course
        return out

    def released(self) -> Jacobian:
        """Return it without its arrays, to free memory."""
        none = np.empty((0, 0, 0), np.float32)
        return dataclasses.replace(self, lit=none, turn=none, grads=(), series={}, lean=None)

    def brighter(self, residual: Float32Array) -> FloatArray:
        """Relative change of the wall by least squares on the training frames, (lines, strips)."""
        lit = self.lit[self.data.training]
        seen = (lit * residual[self.data.training]).sum(axis=0, dtype=np.float64)
        return np.asarray(seen / np.maximum((lit * lit).sum(axis=0, dtype=np.float64), TINY))


def slopes_of(
    theory: ForwardModel, rows: Float32Array, data: Measured, knobs: Sequence[FitParameter] = ()
) -> Jacobian:
    """Compute the Jacobian of a forward model.

    Parameters
    ----------
    theory : ForwardModel
    rows : ndarray of float32 (frames, lines, strips)
        Its prediction.
    data : Measured
    knobs : sequence of FitParameter, optional
    """
    middle_s = data.time_s + 0.5 * theory.model.shutter.read_out_time_s
    series = {
        effect.name: response(theory, rows, data, effect, *found)
        for effect in theory.model.effects
        if (found := series_of(effect)) is not None
    }
    return Jacobian(
        data=data,
        basis=theory.course.basis_at(middle_s),
        lit=(theory.rows(data, lit=1.0 + LIT) - rows) / np.float32(LIT),
        turn=(theory.rows(data, turned_rad=TURN_RAD) - rows) / np.float32(TURN_RAD),
        knobs=tuple(knobs),
        grads=tuple(by_knob(theory, rows, data, knob) for knob in knobs),
        series=series,
        lean=by_lean(theory, rows, data) if leans(theory) else None,
    )


def by_knob(
    theory: ForwardModel, rows: Float32Array, data: Measured, knob: FitParameter
) -> Float32Array:
    """Derivative of the rows by a fit parameter, (frames, lines, strips)."""
    moved = theory.with_model(knob.moved(theory.model, knob.step)).rows(data)
    return np.asarray((moved - rows) / np.float32(knob.step))
