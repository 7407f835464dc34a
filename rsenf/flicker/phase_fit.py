"""The flicker's phase over one window: most probable path, given the grid's habits and the frames.

Each column of the reduced profiles is a constant plus the flicker's harmonics, of which only the
common phase moves::

    r_i(n) = c_i + Re Σ_k C_ik·exp(j·k·φ(t_n)) + noise

Constants and amplitudes follow from the phase by least squares, the phase from them by
Gauss-Newton steps under the Gaussian-process prior of :mod:`rsenf.flicker.grid_prior`; in turn,
until the phase rests. The prior lets the phase follow no faster than grids do, so how long the
data are averaged is settled by how noisy they are. Noise is measured at each harmonic's alias,
from what the model leaves there: after a codec it is far from white.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import NODE_S, NODES_PER_S, phase_prior
from rsenf.flicker.node_noise import noise_of, noise_of_turning
from rsenf.flicker.node_sums import Frames, Gathered, Told
from rsenf.flicker.turning import turning

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

HARMONICS = 3
# Further ones tell no phase, but a codec makes them, and they lie near the first.
NUISANCES = 7
# Relative size that harmonics may have a priori: where two of them share an alias (one mirrored),
# the first is believed first.
HARMONIC_SIZE = (3.0, 0.3, 0.1, 0.1, 0.1, 0.1, 0.1)
RIDGE = 1e-4
# Power over noise at which they are taken in.
STANDS_OUT = 20.0
# The flicker's size is taken over so many nodes, and held to the window's by so much of its weight.
GAIN_WINDOW, STEADY = np.hanning(26)[1:-1], 0.1
# Degrees of freedom of Student's distribution: key frames and cuts are rare and far out.
TAILS = 4.0
MAX_STEPS = 16
REST, NEARLY = 1e-2, 1.0
REST_RAD, NEARLY_RAD = 2e-4, 2e-3
# Noise is told from bands around the tone. What is in quadrature to the phase can be taken from
# close by; along it, the phase has followed whatever is slow.
COLUMNS_HZ, ALONG_HZ, ACROSS_HZ = (0.3, 1.6), (0.2, 0.8), (0.05, 0.5)
# What turns slower than a hertz keeps so much of its length in a node's mean.
SLOW = float(np.sinc(NODE_S))
# A column's amplitude counts as far as it is beyond this many of its variances.
SIGNIFICANT = 4.0


@dataclass(frozen=True, eq=False)
class PhaseFit:
    """The phase in a window, relative to the nominal frequency's.

    Attributes
    ----------
    psi_rad : ndarray, shape (nodes,)
    second_var_hz2 : ndarray, shape (nodes − 4,)
        Variance of the mean frequency over the second that begins at each node.
    template : ndarray of complex, shape (columns,)
        Amplitudes ``C_1`` of the first harmonic in each column.
    weights : ndarray, shape (columns,)
        One over the noise variance of a frame in each column near the first harmonic.
    information : ndarray, shape (nodes,)
        Fisher information of the data about each node's phase.
    gain : ndarray, shape (nodes,)
        Size of the first harmonic around each node, relative to the window's.
    t_s : ndarray, shape (frames,)
        Times of the frames since the window's first node.
    deviation : ndarray of complex, shape (frames,)
        What each frame says beyond the fit, relative to the first harmonic: its real part is a
        change of size, its imaginary part of phase.
    """

    psi_rad: Float
    second_var_hz2: Float
    template: Complex
    weights: Float
    information: Float
    gain: Float
    t_s: Float
    deviation: Complex


def fit_phase(frames: Frames, psi_rad: Float) -> PhaseFit:
    """Find the most probable phase near a first guess.

    Parameters
    ----------
    frames : Frames
    psi_rad : ndarray, shape (nodes,)
        First guess of the phase at nodes ``NODE_S`` apart, relative to the nominal frequency's.
    """
    gathered = Gathered(frames, psi_rad.size)
    fit, loudest = _settled(frames, gathered, psi_rad)
    if loudest == 1:
        return fit
    # What is taken for an overtone is louder than the flicker itself: it is the flicker.
    nearer = _as_first(gathered, fit.psi_rad, loudest)
    if nearer is None:
        return fit
    other, loudest = _settled(frames, gathered, nearer)
    return other if loudest == 1 else fit


def _as_first(frames: Gathered, psi_rad: Float, order: int) -> Float | None:
    """Phase by which a harmonic of this path is the first; None where its alias is elsewhere.

    Where the alias is a third of the frame rate, the second harmonic's mirror image lies on it.
    A path that takes the flicker for that image wanders half as much, the other way, and grids
    are more likely to wander less.
    """
    phase = order * frames.phase_rad(psi_rad)
    frames_at = frames.there.sum(axis=1)
    seen = np.flatnonzero(frames_at)
    for sign in (-1.0, 1.0):
        own = frames.there * turning(sign * phase - frames.carrier_rad)
        turn = own.sum(axis=1)[seen]
        if np.median(np.abs(turn) / frames_at[seen]) > SLOW:
            phases = np.unwrap(np.angle(turn))
            return np.asarray(np.interp(np.arange(psi_rad.size), seen, phases))
    return None


def _settled(frames: Frames, gathered: Gathered, psi_rad: Float) -> tuple[PhaseFit, int]:
    """Most probable phase near a first guess, and which harmonic is the loudest."""
    prior = phase_prior(psi_rad.size)
    coefficient = prior.nearest(psi_rad)
    trust = np.ones(psi_rad.size)
    orders = tuple(range(1, HARMONICS + 1))
    settled = False
    for _ in range(MAX_STEPS):
        turn = gathered.there * turning(gathered.phase_rad(prior.basis @ coefficient))
        waves = gathered.waves(turn, orders)
        amplitude = _amplitudes(gathered.told(waves), trust, orders)
        gradient, information, trust, gain = _likelihood(amplitude, trust)
        precision = prior.basis.T @ (information[:, None] * prior.basis)
        precision.flat[:: len(precision) + 1] += 1.0
        step = np.linalg.solve(precision, prior.basis.T @ gradient - coefficient)
        moved = prior.basis @ step
        shape = moved - moved.mean()
        # How far the step goes, in standard errors all told, and in rad.
        far, farthest = float(shape @ (information * shape)), float(np.abs(shape).max())
        coefficient = coefficient + step * min(1.0, 1.0 / max(farthest, 1e-12))
        if far < (REST if settled else NEARLY) or farthest < (REST_RAD if settled else NEARLY_RAD):
            if settled:
                break
            settled = True
            orders += _nuisances(gathered, turn, waves, amplitude)
    over_second = (prior.basis[NODES_PER_S:] - prior.basis[:-NODES_PER_S]) / (2.0 * np.pi)
    solved = np.linalg.solve(precision, over_second.T)
    fit = PhaseFit(
        psi_rad=prior.basis @ coefficient,
        second_var_hz2=np.einsum("ij,ji->i", over_second, solved),
        template=amplitude.harmonic[0],
        weights=amplitude.weights[0],
        information=information,
        gain=gain,
        t_s=frames.t_s,
        deviation=_deviation(gathered, turn, waves, amplitude),
    )
    return fit, 1 + int(np.argmax(np.sum(np.abs(amplitude.harmonic) ** 2, axis=1)))


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """What follows from a phase by least squares.

    Attributes
    ----------
    harmonic : ndarray of complex, shape (HARMONICS, columns)
        ``C_k``.
    weights : ndarray, shape (HARMONICS, columns)
        One over the columns' noise near each harmonic.
    found : ndarray, shape (waves, columns)
        Each wave's share of the columns.
    told : Told
        The sums that it follows from.
    left : ndarray, shape (nodes, HARMONICS, columns)
        Sums of what the model leaves times ``exp(j·k·φ)``.
    """

    harmonic: Complex
    weights: Float
    found: Float
    told: Told
    left: Complex


def _amplitudes(told: Told, trust: Float, orders: tuple[int, ...]) -> Amplitudes:
    gram = _weighted(trust, told.waves)
    seen, weight = float(told.waves[:, 0, 0].sum()), float(gram[0, 0])
    ridge = np.repeat([RIDGE * seen / HARMONIC_SIZE[k - 1] ** 2 for k in orders], 2)
    gram.flat[:: len(gram) + 1] += np.concatenate([[0.0], ridge])
    found = np.asarray(np.linalg.solve(gram, _weighted(trust, told.columns)))
    real, imag = _left(told, found)
    raw = found[1 : 2 * HARMONICS : 2] - 1j * found[2 : 2 * HARMONICS + 1 : 2]
    own = trust[:, None, None]
    noise = noise_of_turning(own * real, own * imag, COLUMNS_HZ) / weight
    noise = np.maximum(noise, 1e-6 * noise.max(axis=1, keepdims=True) + 1e-12)
    doubt = SIGNIFICANT * 4.0 * noise / seen
    shrink = np.maximum(0.0, 1.0 - doubt / np.maximum(np.abs(raw) ** 2, 1e-30))
    return Amplitudes(raw * shrink, np.asarray(1.0 / noise), found, told, real + 1j * imag)


def _weighted(trust: Float, sums: Float) -> Float:
    """Add up sums at the nodes, each by how far it is trusted."""
    return (trust @ sums.reshape(trust.size, -1)).reshape(sums.shape[1:])


def _left(told: Told, found: Float) -> tuple[Float, Float]:
    """Sums of what is left of the columns times cosine and sine of the harmonics.

    Shapes (nodes, harmonics, columns): what the waves found would have added up to is taken away.
    """
    own = slice(1, 1 + 2 * HARMONICS)
    modelled = told.waves[:, own].reshape(-1, len(found)) @ found
    left = told.columns[:, own] - modelled.reshape(told.columns[:, own].shape)
    return left[:, 0::2], left[:, 1::2]


def _nuisances(
    frames: Gathered, turn: Complex, waves: Float, amplitude: Amplitudes
) -> tuple[int, ...]:
    """Further harmonics that stand out of what the first ones leave of some column."""
    further = tuple(range(HARMONICS + 1, NUISANCES + 1))
    left = frames.columns - waves.transpose(0, 2, 1) @ amplitude.found
    told = frames.waves(turn, further)[:, 1:] @ left
    real, imag = told[:, 0::2], told[:, 1::2]
    power = real.sum(axis=0) ** 2 + imag.sum(axis=0) ** 2
    stands_out = np.any(power > STANDS_OUT * noise_of_turning(real, imag, COLUMNS_HZ), axis=1)
    return tuple(k for k, there in zip(further, stands_out, strict=True) if there)


def _deviation(frames: Gathered, turn: Complex, waves: Float, amplitude: Amplitudes) -> Complex:
    weighted = amplitude.weights[0] * amplitude.harmonic[0].conj()
    power = float(np.sum(weighted * amplitude.harmonic[0]).real)
    if power <= 0.0:
        return np.zeros(frames.frames, np.complex128)
    model = np.einsum("nwp,w->np", waves, amplitude.found @ weighted)
    left = frames.columns @ weighted - model
    return frames.in_order(2.0 * left * turn.conj() / power)


@functools.cache
def _around(nodes: int) -> Float:
    """Matrix that sums over the nodes around each, by :data:`GAIN_WINDOW`."""
    return np.array([np.convolve(one, GAIN_WINDOW, "same") for one in np.eye(nodes)]).T


def _gain(across: Float, expected: Float) -> Float:
    """Size of the flicker around each node relative to the window's, at most one and a half."""
    around = _around(across.shape[0])
    beyond, share = around @ across, around @ expected
    steady = STEADY * share.max(axis=0)
    gain = 1.0 + beyond / np.maximum(share + steady, 1e-30)
    return np.asarray(np.minimum(np.maximum(gain, 0.0), 1.5))


def _likelihood(amplitude: Amplitudes, trust: Float) -> tuple[Float, Float, Float, Float]:
    """Gradient and information of the phase at each node, from all harmonics.

    Also how far each node is trusted next time, and the first harmonic's gain.
    """
    order = np.arange(1, HARMONICS + 1)
    weighted = amplitude.weights * amplitude.harmonic
    left = order * np.einsum("nkc,kc->nk", amplitude.left, weighted)
    told, across = -left.imag, left.real
    # The sum over the columns of a wave's square, along the phase: Σ w·(k·Im turn·C)².
    power = (weighted * amplitude.harmonic.conj()).sum(axis=1).real
    turned = (weighted * amplitude.harmonic).sum(axis=1)
    frames_at, squared = _squares(amplitude.told)
    expected = 0.5 * order**2 * (power * frames_at - (squared * turned).real)
    hears = expected.sum(axis=0) > 0.0
    own = trust[:, None]
    total = np.where(hears, (own * expected).sum(axis=0), 1.0)
    # The columns' noise may go together: what is left of their sum says how much.
    noise = np.maximum(noise_of(own * told, ALONG_HZ), noise_of(own * across, ACROSS_HZ))
    excess = np.maximum(noise / total, 1e-3)
    gain = _gain(own * across, own * expected)
    gradient = np.where(hears, gain * own * told / excess, 0.0).sum(axis=1)
    information = np.where(hears, gain**2 * own * expected / excess, 0.0).sum(axis=1)
    if not hears[0]:
        return gradient, information, trust, np.ones(trust.size)
    away = told[:, 0] ** 2 + across[:, 0] ** 2
    away /= np.maximum(expected[:, 0] * excess[0], 1e-30)
    return gradient, information, (TAILS + 2.0) / (TAILS + away), gain[:, 0]


def _squares(told: Told) -> tuple[Float, Complex]:
    """How many frames are around each node, (nodes, 1), and the sums of ``exp(2j·k·φ)``."""
    cosine, sine = (range(first, 2 * HARMONICS + 1, 2) for first in (1, 2))
    of = told.waves
    squared = of[:, cosine, cosine] - of[:, sine, sine] + 2j * of[:, cosine, sine]
    return of[:, :1, 0], squared
