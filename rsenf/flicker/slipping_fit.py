"""Joint fit of a window's phase and of frames lost or repeated in it.

Model: that of :mod:`rsenf.flicker.phase_fit`, with jumps of the phase by whole frames. A fit bends
to follow a jump. So slips are detected and corrected, and the fit repeated, until no new one is
found: first clear jumps, frame by frame (:mod:`rsenf.flicker.frame_slips`), then small ones, from
what the bent fit leaves.

Statistic: the score test of a linear model with known noise. With the covariance of noise and
smooth course together, a step at a place is estimated by generalised least squares; its square over
its variance is twice the log likelihood ratio against no step.

Approximate: a course that wanders more than its prior makes spurious steps; so the statistic is
relative to its median in the window.

References
----------
- Rao, C. R. (1948), Large sample tests of statistical hypotheses, Proc. Cambridge Philosophical
  Society 44, 50.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.frame_slips import (
    LEAST_STEP_LOG_RATIO,
    MOST_AT_ONCE,
    are_equal,
    find_slips,
    frames_of_step,
    late_s,
)
from rsenf.flicker.grid_prior import NODES_PER_S, phase_prior
from rsenf.flicker.lines import ProfileBasis
from rsenf.flicker.phase_fit import PhaseFit, fit_phase
from rsenf.flicker.phase_likelihood import WindowFrames, at_frames
from rsenf.flicker.tone import turning
from rsenf.medians import MEDIAN_SQUARE

Float = NDArray[np.float64]

PARTS = 8  # places within a point at which a step may be


@dataclass(frozen=True, eq=False)
class Steps:
    """Step estimates at ``PARTS`` places within each point.

    Attributes
    ----------
    size, std : ndarray, shape (points, PARTS)
        The step before the last ``k/PARTS`` of what a point averages, and its standard error.
    """

    size: Float
    std: Float

    @property
    def log_ratio(self) -> Float:
        """Log likelihood ratio against no step, shape (points, PARTS) (Rao 1948)."""
        return np.asarray(0.5 * (self.size / self.std) ** 2)


def steps_in(course: Float, precision: Float) -> Steps:
    """Estimate a step in a course at every place.

    Parameters
    ----------
    course : ndarray, shape (points,)
        The course.
    precision : ndarray, shape (points, points)
        Inverse of the covariance of noise and course together.
    """
    score = precision @ course
    after = np.triu(precision, 1)
    beside = after.sum(axis=1)
    later = _later(np.diag(precision) + 2.0 * beside)  # over all pairs of later points
    share = np.arange(PARTS) / PARTS
    top = _later(score)[:, None] + share * score[:, None]
    diagonal = np.diag(precision)[:, None]
    information = later[:, None] + 2.0 * share * beside[:, None] + share**2 * diagonal
    information = np.maximum(information, max(1e-12 * information.max(), 1e-300))
    usual = max(float(np.median(top[1:-1] ** 2 / information[1:-1])) / MEDIAN_SQUARE, 1.0)
    return Steps(top / information, np.sqrt(usual / information))


def precision_of(information: Float, course: Float) -> Float:
    """Inverse covariance of noise plus a course in independent directions (Woodbury 1950).

    Parameters
    ----------
    information : ndarray, shape (points,) or (points, points)
        Inverse covariance of the noise; one dimension if independent.
    course : ndarray, shape (points, directions)
        The directions, each of unit variance.
    """
    inverse = np.diag(information) if information.ndim == 1 else information
    heard = inverse @ course
    both = course.T @ heard
    both.flat[:: len(both) + 1] += 1.0
    return np.asarray(inverse - heard @ np.linalg.solve(both, heard.T))


def _later(values: Float) -> Float:
    """Sum of all values after each."""
    return np.asarray(np.cumsum(values[::-1])[::-1] - values)


Complex = NDArray[np.complex128]
Slips = list[tuple[int, int]]

# Least frames between places, attempt by attempt: at first each slip bends the phase around it.
APART = (32, 1, 1, 1)
BESIDE = 16  # least frames between small jumps and other slips, or the ends


@dataclass(frozen=True, eq=False)
class SlipWindow:
    """Frames of some seconds, and what is known of their light's phase.

    Attributes
    ----------
    t_s : ndarray, shape (frames,)
        Times since the stream's first frame.
    columns : ndarray, shape (frames, columns)
        Reduced profiles.
    start : int
        Second at which the window begins.
    period_s : float
        Frame period.
    nominal_hz : float
        Nominal grid frequency.
    guess_rad : ndarray, shape (nodes,)
        Guess of the phase, relative to the nominal frequency's.
    basis : ProfileBasis
    turns : float
        Guess of the first harmonic's turns down the rows.
    """

    t_s: Float
    columns: Float
    start: int
    period_s: float
    nominal_hz: float
    guess_rad: Float
    basis: ProfileBasis
    turns: float

    def fit(self, first: int) -> tuple[PhaseFit, Slips]:
        """Fit the phase, and find the slips from frame ``first`` on, until both are consistent.

        If they never are, the result is that without slips.
        """
        settled = self._settled(self._tried([], self.guess_rad), first)
        for _ in range(MOST_AT_ONCE):
            step = settled.step(first)
            slips = sorted([*settled.slips, *step])
            if not step or self._is_disordered(slips):
                break
            settled = self._tried(slips, settled.fit.psi_rad)
        return settled.fit, settled.slips

    def _settled(self, as_if: _Tried, first: int) -> _Tried:
        """Correct clear jumps."""
        tried = as_if
        for apart in APART:
            slips = find_slips(tried.seen, tried.step_rad, tried.equal, first, apart)
            if slips == tried.slips:
                return tried
            if self._is_disordered(slips):
                break
            light = tried.seen * turning(tried.step_rad / -self.period_s * self._late(slips))
            tried = self._tried(slips, self.guess_rad + self._at_nodes(light))
        return as_if

    def _is_disordered(self, slips: Slips) -> bool:
        """Whether some frame would be older than the one before it."""
        return bool(np.diff(self.t_s + self._late(slips)).min() < -0.5 * self.period_s)

    def _tried(self, slips: Slips, nearer_rad: Float) -> _Tried:
        """Fit near a guess that may bend; the reference of the comparison must not."""
        late = self._late(slips)
        carrier_rad = 4.0 * np.pi * self.nominal_hz * (self.t_s + late)
        frames = WindowFrames(self.t_s + late - self.start, carrier_rad, self.columns)
        fit = fit_phase(frames, nearer_rad, self.basis, self.turns)
        ahead = at_frames(fit.t_s, fit.psi_rad) - at_frames(fit.t_s, self.guess_rad)
        turned = float(fit.psi_rad[-1] - fit.psi_rad[0]) * NODES_PER_S / (fit.psi_rad.size - 1)
        step_rad = (4.0 * np.pi * self.nominal_hz + turned) * self.period_s
        seen = (1.0 + fit.deviation) * turning(ahead + step_rad / self.period_s * late)
        return _Tried(fit, slips, seen, step_rad, are_equal(self.columns, 1.0 / fit.weights))

    def _late(self, slips: Slips) -> Float:
        return late_s(slips, self.t_s.size, self.period_s)

    def _at_nodes(self, light: Complex) -> Float:
        """Unwrapped phase of the frames' light, at the nodes."""
        nodes = self.guess_rad.size
        nearest = np.clip(
            np.rint((self.t_s - self.start) * NODES_PER_S).astype(np.intp), 0, nodes - 1
        )
        real, imag = (np.bincount(nearest, part, nodes) for part in (light.real, light.imag))
        there = np.flatnonzero(np.bincount(nearest, minlength=nodes))
        phase = np.unwrap(np.angle(real[there] + 1j * imag[there]))
        return np.asarray(np.interp(np.arange(nodes), there, phase))


@dataclass(frozen=True, eq=False)
class _Tried:
    """A fit with assumed slips, and each frame's flicker relative to the guess without any."""

    fit: PhaseFit
    slips: Slips
    seen: Complex
    step_rad: float
    equal: NDArray[np.bool_]

    def step(self, first: int) -> Slips:
        """Find the likeliest small jump from a frame on, if it exceeds the threshold."""
        fit, nodes = self.fit, self.fit.psi_rad.size
        nearest = np.clip(np.rint(fit.t_s * NODES_PER_S).astype(np.intp), 0, nodes - 1)
        beyond = np.bincount(nearest, fit.deviation.imag, nodes)
        course = fit.psi_rad + beyond / np.maximum(np.bincount(nearest, minlength=nodes), 1)
        steps = steps_in(
            course - course.mean(), precision_of(fit.information, phase_prior(nodes).basis)
        )
        share = np.arange(PARTS) / PARTS
        at = fit.t_s.searchsorted((np.arange(nodes)[:, None] + 0.5 - share) / NODES_PER_S)
        free = (at >= max(first, BESIDE)) & (at <= fit.t_s.size - BESIDE)
        for place, _ in self.slips:
            free &= np.abs(at - place) >= BESIDE
        likely = np.where(free, steps.log_ratio, 0.0)
        best = np.unravel_index(int(likely.argmax()), likely.shape)
        if likely[best] < LEAST_STEP_LOG_RATIO:
            return []
        frames = frames_of_step(float(steps.size[best]), float(steps.std[best]), self.step_rad)
        return [(int(at[best]), frames)] if frames else []
