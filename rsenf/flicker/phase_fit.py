"""Posterior mode of the flicker's phase in one window, given the grid's prior and the frames.

Model: each column of the reduced profiles is a constant plus the flicker's harmonics, which share
one phase::

    r_i(n) = c_i + Re Σ_k C_ik·exp(j·k·φ(t_n)) + noise

Likelihood: Gaussian with Student-t weights per node, times the Gaussian-process prior of
:mod:`rsenf.flicker.grid_prior`, which limits how fast the phase may change, so that the averaging
time adapts to the noise. Constants and amplitudes follow from the phase by linear least squares;
the phase follows from them by a Gauss-Newton step; the two alternate until the phase converges.

Approximate: the noise is measured at each harmonic's alias, from the residual: after a codec it is
far from white. The variance is conditional on the amplitudes, unless the basis of the columns is
given: then the last steps are joint in all unknowns (:mod:`rsenf.flicker.joint_fit`).

References
----------
- Kay, S. M. (1993), Fundamentals of Statistical Signal Processing, vol. I: Estimation Theory.
- Rasmussen, C. E. and Williams, C. K. I. (2006), Gaussian Processes for Machine Learning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import NODE_S, NODES_PER_S, PhasePrior, phase_prior
from rsenf.flicker.joint_fit import JointFit, State
from rsenf.flicker.lines import ProfileBasis, alias_hz
from rsenf.flicker.phase_likelihood import (
    COLUMNS_HZ,
    HARMONICS,
    Amplitudes,
    Gathered,
    WindowFrames,
    amplitudes_of,
    likelihood,
    noise_of_turning,
)
from rsenf.flicker.tone import turning

Float = NDArray[np.float64]


# Further ones hardly inform the phase, but their aliases are near the first's: codecs make
# overtones, and unequal half waves (ageing lamps, half-wave rectifiers) odd halves.
NUISANCES = 7
# Still further ones, used if their aliases are this far from all of these.
FAR, FAR_APART_HZ = 12, 0.2
HALVES = (0.5, 1.5, 2.5, 3.5)
# Power over noise from which they are included.
STANDS_OUT = 20.0
# Most steps; and the step after which further orders are searched at the latest.
MAX_STEPS, LOOK_AFTER = 16, 4
# Convergence, and near convergence: squared step in standard errors; largest step.
REST, NEARLY = 1e-2, 1.0
REST_RAD, NEARLY_RAD = 2e-4, 2e-3
# Mean length over a node of a phasor that turns at 1 Hz; longer for slower ones.
SLOW = float(np.sinc(NODE_S))


@dataclass(frozen=True, eq=False)
class PhaseFit:
    """Phase in a window, relative to the nominal frequency's.

    Attributes
    ----------
    psi_rad : ndarray, shape (nodes,)
    second_var_hz2 : ndarray, shape (nodes − 4,)
        Variance of the mean frequency over the second that begins at each node.
    template : ndarray of complex, shape (columns,)
        Amplitudes ``C_1`` of the first harmonic in each column.
    weights : ndarray, shape (columns,)
        Inverse noise variance of a frame in each column near the first harmonic.
    information : ndarray, shape (nodes,)
        Fisher information of the data about each node's phase.
    gain : ndarray, shape (nodes,)
        Amplitude of the first harmonic around each node, relative to the window's.
    t_s : ndarray, shape (frames,)
        Times of the frames since the window's first node.
    deviation : ndarray of complex, shape (frames,)
        Residual of each frame relative to the first harmonic: its real part is a change of
        amplitude, its imaginary part of phase (rad).
    second_ratio : float
        Amplitude of the second harmonic relative to the first.
    half_ratio : float
        Amplitude of the part at half the frequency relative to the first harmonic.
    """

    psi_rad: Float
    second_var_hz2: Float
    template: Complex
    weights: Float
    information: Float
    gain: Float
    t_s: Float
    deviation: Complex
    second_ratio: float
    half_ratio: float = 0.0


def fit_phase(
    frames: WindowFrames, psi_rad: Float, basis: ProfileBasis | None = None, turns: float = 0.0
) -> PhaseFit:
    """Find the posterior mode of the phase near a first guess (scoring; Kay 1993, ch. 7).

    Parameters
    ----------
    frames : WindowFrames
    psi_rad : ndarray, shape (nodes,)
        First guess of the phase at nodes ``NODE_S`` apart, relative to the nominal frequency's.
    basis : ProfileBasis, optional
        Basis of the columns: with it, phase, amplitudes and ramp are fitted jointly at the end
        (:mod:`rsenf.flicker.joint_fit`). Without it, the variance is conditional on the amplitudes.
    turns : float
        First guess of the first harmonic's turns down the rows.
    """
    gathered = Gathered(frames, psi_rad.size)
    to_rest = basis is None  # else the joint fit continues from near the mode
    settled = _settle(gathered, psi_rad, to_rest=to_rest)
    if settled.loudest != 1:
        # A supposed overtone louder than the flicker is the flicker itself.
        nearer = _as_first(gathered, settled.prior.basis @ settled.coefficient, settled.loudest)
        other = settled if nearer is None else _settle(gathered, nearer, to_rest=to_rest)
        settled = other if other.loudest == 1 else settled
    if basis is None or not settled.amplitude.harmonic[0].any():
        return _alone(frames, gathered, settled)
    return _together(frames, gathered, settled, basis, turns)


@dataclass(frozen=True, eq=False)
class _Settled:
    """A converged phase, and what follows from it; ``covariance`` is the coefficients'."""

    prior: PhasePrior
    coefficient: Float
    covariance: Float
    orders: tuple[float, ...]
    amplitude: Amplitudes
    trust: Float
    information: Float
    gain: Float

    @property
    def loudest(self) -> int:
        """Order of the loudest among the first harmonics."""
        return 1 + int(np.argmax(np.sum(np.abs(self.amplitude.harmonic) ** 2, axis=1)))


def _alone(frames: WindowFrames, gathered: Gathered, settled: _Settled) -> PhaseFit:
    """Return the converged phase as the result, conditional on its amplitudes."""
    amplitude = settled.amplitude
    psi_rad = settled.prior.basis @ settled.coefficient
    return PhaseFit(
        psi_rad=psi_rad,
        second_var_hz2=settled.prior.second_var_hz2(settled.covariance),
        template=amplitude.harmonic[0],
        weights=amplitude.weights[0],
        information=settled.information,
        gain=settled.gain,
        t_s=frames.t_s,
        deviation=_deviation(
            gathered,
            psi_rad,
            settled.orders,
            amplitude.found,
            amplitude.harmonic[0],
            amplitude.weights[0],
        ),
        second_ratio=_size_ratio(amplitude.harmonic, (1, 2, 3), 2),
    )


def _together(
    frames: WindowFrames, gathered: Gathered, settled: _Settled, basis: ProfileBasis, turns: float
) -> PhaseFit:
    """Return the joint fit, started from the converged phase."""
    start = State(settled.coefficient, settled.amplitude.found, settled.trust, settled.gain, turns)
    joint = JointFit(gathered, settled.prior, basis, settled.orders).run(start)
    psi_rad = settled.prior.basis @ joint.state.coefficient
    first = settled.orders.index(1)
    template, weights = joint.state.amplitude[first], np.asarray(1.0 / joint.noise[first])
    return PhaseFit(
        psi_rad=psi_rad,
        second_var_hz2=settled.prior.second_var_hz2(joint.covariance),
        template=template,
        weights=weights,
        information=joint.information,
        gain=settled.gain,
        t_s=frames.t_s,
        deviation=_deviation(
            gathered, psi_rad, settled.orders, joint.state.found, template, weights
        ),
        second_ratio=_size_ratio(joint.state.amplitude, settled.orders, 2),
        half_ratio=_size_ratio(joint.state.amplitude, settled.orders, 0.5),
    )


def _size_ratio(amplitude: Complex, orders: tuple[float, ...], order: float) -> float:
    """Amplitude of an order relative to the first harmonic; 0 if it isn't fitted."""
    if order not in orders:
        return 0.0
    first, other = (np.linalg.norm(amplitude[orders.index(k)]) for k in (1, order))
    return float(other / first) if first else 0.0


def _as_first(frames: Gathered, psi_rad: Float, order: int) -> Float | None:
    """Phase by which a harmonic of this path is the first; None if its alias is elsewhere.

    If the alias is a third of the frame rate, the second harmonic's mirror image coincides with it.
    A path fitted to that image wanders half as much, the other way, and the prior prefers less
    wander.
    """
    phase = order * frames.phase_rad(psi_rad)
    frames_at = frames.there.sum(axis=1)
    filled = np.flatnonzero(frames_at)
    for sign in (-1.0, 1.0):
        phasor = frames.there * turning(sign * phase - frames.carrier_rad)
        turn = phasor.sum(axis=1)[filled]
        if np.median(np.abs(turn) / frames_at[filled]) > SLOW:
            phases = np.unwrap(np.angle(turn))
            return np.asarray(np.interp(np.arange(psi_rad.size), filled, phases))
    return None


def _settle(gathered: Gathered, psi_rad: Float, *, to_rest: bool) -> _Settled:
    """Posterior mode near a first guess, with phase and amplitudes estimated in turn."""
    prior = phase_prior(psi_rad.size)
    coefficient = prior.nearest(psi_rad)
    trust = np.ones(psi_rad.size)
    orders: tuple[float, ...] = tuple(range(1, HARMONICS + 1))
    settled = False
    for done in range(MAX_STEPS):
        phase = gathered.phase_rad(prior.basis @ coefficient)
        waves = gathered.waves(phase, orders)
        amplitude = amplitudes_of(gathered.sums(waves), trust, orders)
        gradient, information, trust, gain = likelihood(amplitude, trust)
        precision = prior.precision(information)
        step = np.linalg.solve(precision, prior.basis.T @ gradient - coefficient)
        moved = prior.basis @ step
        shape = moved - moved.mean()
        # Size of the step: squared, in standard errors in total; and largest, in rad.
        far, farthest = float(shape @ (information * shape)), float(np.abs(shape).max())
        coefficient = coefficient + step * min(1.0, 1.0 / max(farthest, 1e-12))
        near = far < (REST if settled else NEARLY)
        near = near or farthest < (REST_RAD if settled else NEARLY_RAD)
        if settled and (near or not to_rest):
            break
        if not settled and (near or done == LOOK_AFTER):
            settled = True
            more = _nuisances(gathered, phase, waves, amplitude)
            orders += more
            if not (more or to_rest):
                break
            if any(order % 1 for order in more):
                trust = np.ones(psi_rad.size)  # nodes were down-weighted for lack of these
    return _Settled(
        prior=prior,
        coefficient=coefficient,
        covariance=np.asarray(np.linalg.inv(precision), np.float64),
        orders=orders,
        amplitude=amplitude,
        trust=trust,
        information=information,
        gain=gain,
    )


def _nuisances(
    frames: Gathered, phase_rad: Float, waves: Float, amplitude: Amplitudes
) -> tuple[float, ...]:
    """Further orders that stand out of the first ones' residual in some column."""
    near_hz, *far_hz = np.split(
        np.abs([alias_hz(k * frames.carrier_hz, frames.rate_hz) for k in range(1, FAR + 1)]),
        range(NUISANCES, FAR),
    )
    far = tuple(
        NUISANCES + 1 + i
        for i, hz in enumerate(far_hz)
        if np.abs(near_hz - hz).min() > FAR_APART_HZ
    )
    further = tuple(range(HARMONICS + 1, NUISANCES + 1)) + HALVES + far
    residual = frames.columns - waves.transpose(0, 2, 1) @ amplitude.found
    sums = frames.waves(phase_rad, further)[:, 1:] @ residual
    real, imag = sums[:, 0::2], sums[:, 1::2]
    power = real.sum(axis=0) ** 2 + imag.sum(axis=0) ** 2
    stands_out = np.any(power > STANDS_OUT * noise_of_turning(real, imag, COLUMNS_HZ), axis=1)
    return tuple(k for k, there in zip(further, stands_out, strict=True) if there)


def _deviation(
    frames: Gathered,
    psi_rad: Float,
    orders: tuple[float, ...],
    found: Float,
    template: Complex,
    weights: Float,
) -> Complex:
    """Residual of each frame from a model, relative to the first harmonic."""
    weighted = weights * template.conj()
    power = float(np.sum(weighted * template).real)
    if power <= 0.0:
        return np.zeros(frames.frames, np.complex128)
    phase_rad = frames.phase_rad(psi_rad)
    waves = frames.waves(phase_rad, orders)
    model = np.einsum("nwp,w->np", waves, found @ weighted)
    residual = frames.columns @ weighted - model
    return frames.in_order(2.0 * residual * turning(-phase_rad) / power)


class PhasePath:
    """Phase relative to the nominal frequency's, at nodes from second ``first`` on.

    Parameters
    ----------
    psi_rad : ndarray, shape (nodes,)
    first : int
        Second of the first node.
    """

    def __init__(self, psi_rad: Float, first: int) -> None:
        self._psi, self.first = psi_rad, first

    def between(self, start: int, end: int) -> Float:
        """Phase at the nodes of a span of seconds; extrapolated linearly beyond what is known."""
        before = (self.first - start) * NODES_PER_S
        if before > 0:
            slope = self._psi[1] - self._psi[0]
            self._psi = np.concatenate([self._psi[0] + slope * np.arange(-before, 0), self._psi])
            self.first = start
        lacks = (end - self.first) * NODES_PER_S + 1 - self._psi.size
        if lacks > 0:
            slope = self._psi[-1] - self._psi[-2]
            self._psi = np.concatenate([self._psi, self._psi[-1] + slope * np.arange(1, lacks + 1)])
        a, b = ((s - self.first) * NODES_PER_S for s in (start, end))
        return self._psi[a : b + 1].copy()

    def set(self, start: int, psi_rad: Float) -> None:
        """Replace the phase from second ``start`` on by a fit's."""
        a = (start - self.first) * NODES_PER_S
        self._psi[a : a + psi_rad.size] = psi_rad

    def forget_before(self, second: int) -> None:
        """Drop the nodes before a second."""
        if second > self.first:
            self._psi = self._psi[(second - self.first) * NODES_PER_S :]
            self.first = second


Complex = NDArray[np.complex128]
