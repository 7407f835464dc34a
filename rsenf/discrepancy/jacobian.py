"""Jacobian of the rows by the parameters of a forward model, by finite differences of it."""

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
    """Derivatives of the rows at one theory, (frames, lines, strips) each.

    Attributes
    ----------
    data : Measured
    basis : ndarray (frames, directions)
        The course's directions at each frame.
    lit : ndarray of float32
        By the wall's brightness, relative to it.
    turn : ndarray of float32
        By the light's phase (1/rad).
    knobs : tuple of FitParameter
    own : tuple of ndarray of float32
        By each knob.
    series : dict of str to ndarray of float32
        By the values of each effect that has a series, all of them at once.
    lean : ndarray of float32 or None
        By the wall's lean, where there is light to which it matters.
    """

    data: Measured
    basis: FloatArray
    lit: Float32Array
    turn: Float32Array
    knobs: tuple[FitParameter, ...]
    own: tuple[Float32Array, ...]
    series: dict[str, Float32Array]
    lean: Float32Array | None = None

    @cached_property
    def training(self) -> System:
        """What the training frames tell of course and knobs."""
        frames = self.data.training
        return System(self.lit, self.turn, self.basis[frames], lambda a: a[frames]).plus(self.own)

    @cached_property
    def course(self) -> System:
        """What one half of every frame tells of the course."""
        first = self.data.first  # not self: nothing would let go of its arrays then
        return System(self.lit, self.turn, self.basis, lambda a: a[first])

    def plus(self, knobs: Sequence[FitParameter], own: Sequence[Float32Array]) -> Jacobian:
        """Return them with those of more knobs."""
        out = dataclasses.replace(self, knobs=(*self.knobs, *knobs), own=(*self.own, *own))
        # What is known already isn't reckoned again.
        out.__dict__["training"] = self.training.plus(own)
        out.__dict__["course"] = self.course
        return out

    def released(self) -> Jacobian:
        """Return them without the arrays."""
        none = np.empty((0, 0, 0), np.float32)
        return dataclasses.replace(self, lit=none, turn=none, own=(), series={}, lean=None)

    def brighter(self, residual: Float32Array) -> FloatArray:
        """By how much training frames say that the wall is brighter, relative to it."""
        lit = self.lit[self.data.training]
        seen = (lit * residual[self.data.training]).sum(axis=0, dtype=np.float64)
        return np.asarray(seen / np.maximum((lit * lit).sum(axis=0, dtype=np.float64), TINY))


def slopes_of(
    theory: ForwardModel, rows: Float32Array, data: Measured, knobs: Sequence[FitParameter] = ()
) -> Jacobian:
    """Turn the light, brighten the wall, turn every knob, and see what that does.

    Parameters
    ----------
    theory : ForwardModel
    rows : ndarray of float32 (frames, lines, strips)
        What it says.
    data : Measured
    knobs : sequence of FitParameter, optional
    """
    middle_s = data.time_s + 0.5 * theory.model.shutter.read_out_time_s
    series = {
        effect.name: response(theory, rows, data, effect, *told)
        for effect in theory.model.effects
        if (told := series_of(effect)) is not None
    }
    return Jacobian(
        data=data,
        basis=theory.course.basis_at(middle_s),
        lit=(theory.rows(data, lit=1.0 + LIT) - rows) / np.float32(LIT),
        turn=(theory.rows(data, turned_rad=TURN_RAD) - rows) / np.float32(TURN_RAD),
        knobs=tuple(knobs),
        own=tuple(by_knob(theory, rows, data, knob) for knob in knobs),
        series=series,
        lean=by_lean(theory, rows, data) if leans(theory) else None,
    )


def by_knob(
    theory: ForwardModel, rows: Float32Array, data: Measured, knob: FitParameter
) -> Float32Array:
    """What the rows do, per unit, when a knob is turned."""
    moved = theory.with_model(knob.moved(theory.model, knob.step)).rows(data)
    return np.asarray((moved - rows) / np.float32(knob.step))
