"""Forward model of a recording: a capture model and a course of the light's phase, simulated.

There is no second model in the workflow: whatever a theory says of the data is said by
:func:`rsenf.model.simulate_rows`, noise left out.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.flicker.grid_prior import NODE_S, phase_prior
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel, GridPath, Scene, simulate_rows
from rsenf.model.chain import Chain
from rsenf.model.clip import Clip
from rsenf.model.sensor import WHITE

BEFORE, AFTER = 4, 8  # nodes beyond the clip's ends
SEED = 0  # of what an effect draws and a fit doesn't know


@dataclass(frozen=True, eq=False)
class Course:
    """The course of the light's phase, as the grid's habits allow it.

    Attributes
    ----------
    weights : ndarray (directions,)
        Of the principal directions of :func:`rsenf.flicker.grid_prior.phase_prior`, each of unit
        variance a priori.
    nodes : int
        Nodes ``NODE_S`` apart, the first ``BEFORE`` of them before the clip begins.
    nominal_hz : float
    """

    weights: FloatArray
    nodes: int
    nominal_hz: float

    @classmethod
    def for_time(cls, duration_s: float, nominal_hz: float) -> Course:
        """Return the course of a grid at its nominal frequency."""
        nodes = math.ceil(duration_s / NODE_S) + BEFORE + AFTER
        return cls(np.zeros(phase_prior(nodes).basis.shape[1]), nodes, nominal_hz)

    @property
    def node_s(self) -> FloatArray:
        """Time of each node, from the clip's first line on."""
        return np.asarray((np.arange(self.nodes) - BEFORE) * NODE_S)

    @property
    def psi_rad(self) -> FloatArray:
        """Phase at the nodes, relative to the nominal frequency's."""
        return np.asarray(phase_prior(self.nodes).basis @ self.weights)

    def basis_at(self, t_s: FloatArray) -> FloatArray:
        """Phase of unit weights at some times, (times, directions)."""
        basis, at = phase_prior(self.nodes).basis, t_s / NODE_S + BEFORE
        left = np.clip(at.astype(np.intp), 0, self.nodes - 2)
        beyond = (at - left)[:, None]
        return np.asarray(basis[left] * (1.0 - beyond) + basis[left + 1] * beyond)

    def through(self, psi_rad: FloatArray) -> Course:
        """Return the course nearest to phases at the nodes."""
        return dataclasses.replace(self, weights=phase_prior(self.nodes).nearest(psi_rad))

    def moved(self, by: FloatArray) -> Course:
        """Return the course with other weights."""
        return dataclasses.replace(self, weights=self.weights + by)

    def grid(self) -> GridPath:
        """Return it as the frequency of a grid, from the clip's first line on."""
        freq_hz = self.nominal_hz + np.diff(self.psi_rad) / (4.0 * math.pi * NODE_S)
        return GridPath(freq_hz, NODE_S, BEFORE * NODE_S, self.nominal_hz)


@dataclass(frozen=True, eq=False)
class ForwardModel:
    """What a recording is held to be, down to each line's level.

    Attributes
    ----------
    model : CaptureModel
        All but what differs from clip to clip: the light's course and the wall.
    course : Course
    wall : ndarray (lines, strips)
        Levels under the mean light.
    lean : ndarray (lines, strips)
        By how much of that the second half of each strip is brighter, and the first darker: where
        in a strip its light comes from. It matters to light that changes along the lines.
    """

    model: CaptureModel
    course: Course
    wall: FloatArray
    lean: FloatArray

    def with_model(self, model: CaptureModel) -> ForwardModel:
        """Return it with another model."""
        return dataclasses.replace(self, model=model)

    def otherwise_delivered(
        self, model: CaptureModel, data: Measured, ahead_rad: FloatArray
    ) -> ForwardModel:
        """Return it with a model that delivers other frames, each in its phase as measured.

        Parameters
        ----------
        model : CaptureModel
        data : Measured
        ahead_rad : ndarray (frames,)
            By which the flicker of each measured frame is ahead of this theory's.
        """
        clip = plan(model, data)
        taken_s = clip.start_s[clip.number[data.slot]]
        # What was taken for a leap of the phase is a leap of time.
        late_s = taken_s - data.time_s
        psi_rad = np.interp(data.time_s, self.course.node_s, self.course.psi_rad) + ahead_rad
        psi_rad = np.unwrap(psi_rad - 4.0 * math.pi * self.course.nominal_hz * late_s)
        course = self.course.through(np.interp(self.course.node_s, taken_s, psi_rad))
        return dataclasses.replace(self, model=model, course=course)

    def whole(self, turned_rad: float = 0.0) -> CaptureModel:
        """Return its model with the wall and the phase that the light has at the first line.

        Parameters
        ----------
        turned_rad : float, optional
            By which the light is ahead of that.
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
        """Simulate the rows of the measured frames, (frames, lines, strips), without noise.

        Parameters
        ----------
        data : Measured
            Which frames.
        turned_rad : float, optional
            By which the light is ahead.
        lit : float, optional
            By which all the wall is brighter.
        """
        theory = dataclasses.replace(self, wall=self.wall * lit) if lit != 1.0 else self
        model = theory.whole(turned_rad)
        duration_s = plan(model, data).start_s.size / float(data.frame_rate)
        made = simulate_rows(
            model, self.course.grid(), duration_s, SEED, strips=data.strips, noise=False,
            averaged_rows=data.group,
        )  # fmt: skip
        return made.level[data.slot]


def plan(model: CaptureModel, data: Measured) -> Clip:
    """Return the plan of all frames that a model takes for as many to arrive as were measured."""
    wanted = int(data.slot[-1]) + 1
    count = wanted
    while True:
        clip = Chain(model, count, SEED).clip()
        if clip.number.size >= wanted:
            return clip
        count += wanted - clip.number.size
