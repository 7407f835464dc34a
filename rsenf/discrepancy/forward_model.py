"""Forward model of a recording: a capture model, the light's phase course and the wall, simulated.

The workflow has no second model: all predictions are made by :func:`rsenf.model.simulate_rows`,
without noise.

A lamp to one side gives light that varies along the lines. A strip sees it as at its centroid of
brightness, not at its middle. So each half of a strip has its own level, fitted to training frames
with a prior of standard deviation :data:`ASYMMETRY_STD`.

A shift of the centroid that is common to all lines of a strip, as by vignetting, can't be told from
a weaker gradient of the light. It is fixed at zero, and its uncertainty enters the standard errors
(:func:`as_walls_may`).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.errors import InputError
from rsenf.flicker.grid_prior import NODE_S, phase_prior
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel, GridPath, Scene, simulate_rows
from rsenf.model.exposures import Chain
from rsenf.model.noise import WHITE
from rsenf.model.shutter import Clip

BEFORE, AFTER = 4, 8  # nodes before and after the clip
SEED = 0  # for values that an effect draws and that aren't fitted
ASYMMETRY_STD, MOST = 0.1, 0.5  # asymmetry of a strip: standard deviation, maximum
STEP = 0.1
MOST_CAPTURED = 20  # frames for each that is delivered


@dataclass(frozen=True, eq=False)
class Course:
    """The light's phase over time: a linear combination of the grid prior's directions."""

    # (directions,) of the principal directions of :func:`rsenf.flicker.grid_prior.phase_prior`; a
    # priori independent and of unit variance
    weights: FloatArray
    nodes: int  # number of nodes, ``NODE_S`` apart, of which ``BEFORE`` precede the clip
    nominal_hz: float  # frequency of the grid

    @classmethod
    def for_time(cls, duration_s: float, nominal_hz: float) -> Course:
        """Return the course of a grid at its nominal frequency, for a clip of ``duration_s``."""
        nodes = math.ceil(duration_s / NODE_S) + BEFORE + AFTER
        return cls(np.zeros(phase_prior(nodes).basis.shape[1]), nodes, nominal_hz)

    @property
    def node_s(self) -> FloatArray:
        """Time of each node, from the clip's first line."""
        return np.asarray((np.arange(self.nodes) - BEFORE) * NODE_S)

    @property
    def psi_rad(self) -> FloatArray:
        """Phase of the light at the nodes, relative to that of the nominal frequency."""
        return np.asarray(phase_prior(self.nodes).basis @ self.weights)

    def basis_at(self, t_s: FloatArray) -> FloatArray:
        """Phase per unit of each weight at given times, (times, directions)."""
        basis, at = phase_prior(self.nodes).basis, t_s / NODE_S + BEFORE
        left = np.clip(at.astype(np.intp), 0, self.nodes - 2)
        beyond = (at - left)[:, None]
        return np.asarray(basis[left] * (1.0 - beyond) + basis[left + 1] * beyond)

    def through(self, psi_rad: FloatArray) -> Course:
        """Return the course nearest to given phases at the nodes."""
        return dataclasses.replace(self, weights=phase_prior(self.nodes).nearest(psi_rad))

    def moved(self, by: FloatArray) -> Course:
        """Return the course with its weights changed by ``by``."""
        return dataclasses.replace(self, weights=self.weights + by)

    def grid(self) -> GridPath:
        """Return the course as the frequency path of a grid, starting at the clip's first line."""
        freq_hz = self.nominal_hz + np.diff(self.psi_rad) / (4.0 * math.pi * NODE_S)
        return GridPath(freq_hz, NODE_S, BEFORE * NODE_S, self.nominal_hz)


@dataclass(frozen=True, eq=False)
class ForwardModel:
    """Everything that determines the noiseless rows of a recording."""

    model: CaptureModel  # all but the light's phase and the wall, which differ from clip to clip
    course: Course
    wall: FloatArray  # (lines, strips) 8-bit levels under the mean light
    # (lines, strips) asymmetry of each strip: its first half has ``1 − lean`` times the level, its
    # second ``1 + lean``. It matters to light that varies along the lines
    lean: FloatArray

    def with_model(self, model: CaptureModel) -> ForwardModel:
        """Return the forward model with another capture model."""
        return dataclasses.replace(self, model=model)

    def otherwise_delivered(
        self, model: CaptureModel, data: Measured, ahead_rad: FloatArray
    ) -> ForwardModel:
        """Return it with a model that delivers other frames, the measured phase of each frame kept.

        Parameters
        ----------
        model : CaptureModel
        data : Measured
        ahead_rad : ndarray (frames,)
            Phase by which the flicker of each measured frame leads this prediction.
        """
        clip = plan(model, data)
        taken_s = clip.start_s[clip.number[data.slot]]
        # What the course has as a jump of phase becomes a jump of time.
        late_s = taken_s - data.time_s
        psi_rad = np.interp(data.time_s, self.course.node_s, self.course.psi_rad) + ahead_rad
        psi_rad = np.unwrap(psi_rad - 4.0 * math.pi * self.course.nominal_hz * late_s)
        course = self.course.through(np.interp(self.course.node_s, taken_s, psi_rad))
        return dataclasses.replace(self, model=model, course=course)

    def whole(self, turned_rad: float = 0.0) -> CaptureModel:
        """Return its capture model complete with wall and initial phase.

        Parameters
        ----------
        turned_rad : float, optional
            Added to the phase of the light.
        """
        psi_rad = float(self.course.psi_rad[BEFORE]) + turned_rad
        light = dataclasses.replace(
            self.model.light, phase_rad=math.remainder(psi_rad, 2.0 * math.pi)
        )
        halves = np.stack([self.wall * (1.0 - self.lean), self.wall * (1.0 + self.lean)], axis=2)
        profile = halves.reshape(len(halves), -1) if self.lean.any() else self.wall
        scene = Scene(profile=tuple(map(tuple, np.minimum(profile, WHITE).tolist())))
        return dataclasses.replace(self.model, light=light, scene=scene)

    def rows(self, data: Measured, *, turned_rad: float = 0.0, lit: float = 1.0) -> Float32Array:
        """Simulate the rows of the measured frames without noise, (frames, lines, strips).

        Parameters
        ----------
        data : Measured
            Which frames, lines and strips.
        turned_rad : float, optional
            Added to the phase of the light.
        lit : float, optional
            Factor of the wall's level.
        """
        forward = dataclasses.replace(self, wall=self.wall * lit) if lit != 1.0 else self
        model = forward.whole(turned_rad)
        duration_s = plan(model, data).start_s.size / float(data.frame_rate)
        made = simulate_rows(
            model, self.course.grid(), duration_s, SEED, strips=data.strips, noise=False,
            averaged_rows=data.group,
        )  # fmt: skip
        is_whole = bool(np.all(np.diff(data.slot) == 1))  # a slice makes no copy
        return made.level[slice(data.slot[0], data.slot[-1] + 1) if is_whole else data.slot]


def plan(model: CaptureModel, data: Measured) -> Clip:
    """Plan enough captured frames for as many to be delivered as were measured.

    Raises
    ------
    InputError
        If the model loses nearly all of them.
    """
    count = wanted = int(data.slot[-1]) + 1
    while count < MOST_CAPTURED * wanted:
        clip = Chain(model, count, SEED).clip()
        if clip.number.size >= wanted:
            return clip
        count += wanted - clip.number.size
    raise InputError("the model loses nearly all frames", "lower drops_per_min")


def leans(forward: ForwardModel) -> bool:
    """Whether the model has light that varies along the lines."""
    strips = forward.wall.shape[1]
    return strips > 1 and any(effect.along_lines for effect in forward.model.effects)


def by_lean(forward: ForwardModel, rows: Float32Array, data: Measured) -> Float32Array:
    """Derivative of the rows by a common asymmetry of all strips, (frames, lines, strips)."""
    moved = dataclasses.replace(forward, lean=forward.lean + STEP).rows(data)
    return slope_of(moved, rows, STEP)


def slope_of(moved: Float32Array, rows: Float32Array, step: float) -> Float32Array:
    """Difference quotient; it takes the place of the moved rows, which nothing else may hold."""
    moved -= rows
    moved /= np.float32(step)
    return moved


def as_walls_may(direction: Float32Array) -> list[Float32Array]:
    """Derivatives of the rows by vignetting, and by a brightness gradient along the lines.

    Both shift the centroids of whole strips: (frames, lines, strips) each, per unit of asymmetry.
    """
    place = np.linspace(-1.0, 1.0, direction.shape[2], dtype=np.float32)
    return [direction * place, direction]


def leaned(
    forward: ForwardModel,
    residual: Float32Array,
    direction: Float32Array,
    data: Measured,
    noise_var: float,
) -> tuple[ForwardModel, Float32Array]:
    """Fit the asymmetry of each line's strips to the training frames; its mean over lines is zero.

    Parameters
    ----------
    forward : ForwardModel
    residual, direction : ndarray of float32 (frames, lines, strips)
        Residual, and result of :func:`by_lean`.
    data : Measured
    noise_var : float
        Variance of a line's noise.

    Returns
    -------
    forward : ForwardModel
    residual : ndarray of float32 (frames, lines, strips)
        Residual after the step, to first order.
    """
    centred, target = direction[data.training], residual[data.training]
    centred = centred - centred.mean(axis=0)  # the mean is explained by the wall
    prior = noise_var / ASYMMETRY_STD**2
    power = (centred * centred).sum(axis=0, dtype=np.float64) + prior
    product = (centred * target).sum(axis=0, dtype=np.float64) - forward.lean * prior
    lean = forward.lean + product / power
    lean = np.clip(lean - lean.mean(axis=0), -MOST, MOST)
    by = (lean - forward.lean).astype(np.float32)
    return dataclasses.replace(forward, lean=lean), residual - by * direction
