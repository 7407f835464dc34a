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
from itertools import accumulate
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import NODE_S, NODES_PER_S, phase_prior

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]
Kind = TypeVar("Kind", np.float64, np.complex128)

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
REST_RAD, NEARLY_RAD = 1e-4, 5e-4
# Noise is told from bands around the tone. What is in quadrature to the phase can be taken from
# close by; along it, the phase has followed whatever is slow.
COLUMNS_HZ, ALONG_HZ, ACROSS_HZ = (0.3, 1.6), (0.2, 0.8), (0.05, 0.5)
# What turns slower than a hertz keeps so much of its length in a node's mean.
SLOW = float(np.sinc(NODE_S))
# A column's amplitude counts as far as it is beyond this many of its variances.
SIGNIFICANT = 4.0


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of one window.

    Attributes
    ----------
    t_s : ndarray, shape (frames,)
        Times since the window's first node.
    carrier_rad : ndarray, shape (frames,)
        Phase of the nominal illumination frequency at each.
    columns : ndarray, shape (frames, columns)
        Reduced profiles.
    """

    t_s: Float
    carrier_rad: Float
    columns: Float


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
    fit, loudest = _settled(frames, psi_rad)
    if loudest == 1:
        return fit
    # What is taken for an overtone is louder than the flicker itself: it is the flicker.
    nearer = _as_first(frames, fit.psi_rad, loudest)
    if nearer is None:
        return fit
    other, loudest = _settled(frames, nearer)
    return other if loudest == 1 else fit


def _as_first(frames: Frames, psi_rad: Float, order: int) -> Float | None:
    """Phase by which a harmonic of this path is the first; None where its alias is elsewhere.

    Where the alias is a third of the frame rate, the second harmonic's mirror image lies on it.
    A path that takes the flicker for that image wanders half as much, the other way, and grids
    are more likely to wander less.
    """
    place = Place(frames.t_s, psi_rad.size)
    phase = order * (frames.carrier_rad + place.at_frames(psi_rad))
    frames_at = place.sums(np.ones(phase.size))
    seen = np.flatnonzero(frames_at)
    for sign in (-1.0, 1.0):
        turn = place.sums(np.exp(1j * (sign * phase - frames.carrier_rad)))[seen]
        if np.median(np.abs(turn) / frames_at[seen]) > SLOW:
            phases = np.unwrap(np.angle(turn))
            return np.asarray(np.interp(np.arange(place.nodes), seen, phases))
    return None


def _settled(frames: Frames, psi_rad: Float) -> tuple[PhaseFit, int]:
    """Most probable phase near a first guess, and which harmonic is the loudest."""
    prior = phase_prior(psi_rad.size).basis
    place = Place(frames.t_s, psi_rad.size)
    coefficient = _project(prior, psi_rad)
    trust = np.ones(psi_rad.size)
    orders = tuple(range(1, HARMONICS + 1))
    settled = False
    for _ in range(MAX_STEPS):
        psi = prior @ coefficient
        amplitude = _amplitudes(frames, place, psi, trust, orders)
        gradient, information, trust, gain = _likelihood(place, amplitude, trust)
        precision = prior.T @ (information[:, None] * prior)
        precision.flat[:: len(precision) + 1] += 1.0
        step = np.linalg.solve(precision, prior.T @ gradient - coefficient)
        moved = prior @ step
        shape = moved - moved.mean()
        largest = np.max(np.abs(shape))
        coefficient = coefficient + step * min(1.0, 1.0 / max(largest, 1e-12))
        # How far the step goes, in standard errors all told, and in rad.
        far, farthest = float(shape @ (information * shape)), float(np.max(np.abs(shape)))
        if far < (REST if settled else NEARLY) or farthest < (REST_RAD if settled else NEARLY_RAD):
            if settled:
                break
            settled = True
            orders += _nuisances(place, amplitude)
    psi = prior @ coefficient
    over_second = (prior[NODES_PER_S:] - prior[:-NODES_PER_S]) / (2.0 * np.pi)
    solved = np.linalg.solve(precision, over_second.T)
    fit = PhaseFit(
        psi_rad=psi,
        second_var_hz2=np.einsum("ij,ji->i", over_second, solved),
        template=amplitude.harmonic[0],
        weights=amplitude.weights[0],
        information=information,
        gain=gain,
        t_s=frames.t_s,
        deviation=_deviation(amplitude),
    )
    power = [float(np.sum(np.abs(c) ** 2)) for c in amplitude.harmonic]
    return fit, 1 + int(np.argmax(power))


class Place:
    """Where the frames, in the order of time, lie between the nodes."""

    def __init__(self, t_s: Float, nodes: int) -> None:
        self.nodes = nodes
        self._left = np.clip((t_s / NODE_S).astype(np.intp), 0, nodes - 2)
        self._beyond = t_s / NODE_S - self._left
        self._nearest = np.clip(np.rint(t_s / NODE_S).astype(np.intp), 0, nodes - 1)
        self._seen, self._first = np.unique(self._nearest, return_index=True)

    def at_frames(self, values: Float) -> Float:
        """Values at nodes, linear in between, at the frames."""
        return values[self._left] * (1.0 - self._beyond) + values[self._left + 1] * self._beyond

    def of_nodes(self, values: Float) -> Float:
        """Value of the nearest node, at the frames."""
        return np.asarray(values[self._nearest])

    def sums(self, values: NDArray[Kind]) -> NDArray[Kind]:
        """Sum over the frames nearest to each node, shape (nodes, …)."""
        out = np.zeros((self.nodes, *values.shape[1:]), values.dtype)
        out[self._seen] = np.add.reduceat(values, self._first, axis=0)
        return out


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """``harmonic[k−1]`` is ``C_k`` (columns,), ``weights[k−1]`` one over its columns' noise."""

    harmonic: list[Complex]
    weights: list[Float]
    turns: list[Complex]  # exp(j·k·φ) at the frames
    residual: Float  # (frames, columns)


def _project(prior: Float, psi_rad: Float) -> Float:
    """Coefficients whose path is nearest to a phase."""
    return np.asarray(np.linalg.lstsq(prior, psi_rad, rcond=1e-9)[0])


def _amplitudes(
    frames: Frames, place: Place, psi: Float, trust: Float, orders: tuple[int, ...]
) -> Amplitudes:
    first = np.exp(1j * (frames.carrier_rad + place.at_frames(psi)))
    powers = list(accumulate([first] * max(orders), np.multiply))
    turns = [powers[k - 1] for k in orders]
    weight = place.of_nodes(trust)
    design = np.column_stack(
        [np.ones(first.size)] + [part for turn in turns for part in (turn.real, turn.imag)]
    )
    weighted = design * weight[:, None]
    gram = weighted.T @ design
    ridge = np.repeat(
        [RIDGE * first.size / size**2 for size in [HARMONIC_SIZE[k - 1] for k in orders]], 2
    )
    gram.flat[:: len(gram) + 1] += np.concatenate([[0.0], ridge])
    found = np.linalg.solve(gram, weighted.T @ frames.columns)
    residual = frames.columns - design @ found
    harmonic, weights = [], []
    for k, turn in enumerate(turns[:HARMONICS]):
        raw = found[1 + 2 * k] - 1j * found[2 + 2 * k]
        noise = _noise(place.sums(residual * (weight * turn.conj())[:, None])) / weight.sum()
        noise = np.maximum(noise, 1e-6 * noise.max() + 1e-12)
        doubt = SIGNIFICANT * 4.0 * noise / first.size
        shrink = np.maximum(0.0, 1.0 - doubt / np.maximum(np.abs(raw) ** 2, 1e-30))
        harmonic.append(raw * shrink)
        weights.append(1.0 / noise)
    return Amplitudes(harmonic, weights, turns, residual)


def _nuisances(place: Place, amplitude: Amplitudes) -> tuple[int, ...]:
    """Further harmonics that stand out in some column."""
    first, out = amplitude.turns[0], []
    for k in range(HARMONICS + 1, NUISANCES + 1):
        turn = first.conj()[:, None] ** k
        demodulated = amplitude.residual * turn
        power = np.abs(demodulated.sum(axis=0)) ** 2
        if np.any(power > STANDS_OUT * _noise(place.sums(demodulated))):
            out.append(k)
    return tuple(out)


def _noise(series: Float | Complex, band_hz: tuple[float, float] = COLUMNS_HZ) -> Float:
    """Power of a node series' transform near, but not at, 0 Hz; shape as one row.

    The median of exponentially distributed powers is ln 2 of their mean, and isn't moved by a
    line nearby.
    """
    waves = _waves(series.shape[0], band_hz, one_sided=series.dtype.kind == "f")
    power = np.abs(waves @ series) ** 2
    middle = power.shape[0] // 2
    if power.shape[0] % 2:
        return np.asarray(np.partition(power, middle, axis=0)[middle] / np.log(2.0))
    halves = np.partition(power, (middle - 1, middle), axis=0)
    return np.asarray((halves[middle - 1] + halves[middle]) / (2.0 * np.log(2.0)))


@functools.cache
def _waves(nodes: int, band_hz: tuple[float, float], *, one_sided: bool) -> Complex:
    """Rows of the discrete Fourier transform that lie in a band; far fewer than all.

    Of a real series both sides have the same powers, and so the same median as one of them.
    """
    freq_hz = np.fft.fftfreq(nodes, NODE_S)
    away = freq_hz if one_sided else np.abs(freq_hz)
    among = np.flatnonzero((away >= band_hz[0]) & (away <= band_hz[1]))
    return np.asarray(np.exp(-2j * np.pi * np.outer(among, np.arange(nodes)) / nodes))


def _deviation(amplitude: Amplitudes) -> Complex:
    weighted = amplitude.weights[0] * amplitude.harmonic[0].conj()
    power = float(np.sum(weighted * amplitude.harmonic[0]).real)
    if power <= 0.0:
        return np.zeros(amplitude.residual.shape[0], np.complex128)
    return np.asarray(2.0 * (amplitude.residual @ weighted) * amplitude.turns[0].conj() / power)


def _gain(across: Float, expected: Float) -> Float:
    """Size of the flicker around each node relative to the window's, at most one and a half."""
    beyond = np.convolve(across, GAIN_WINDOW, "same")
    share = np.convolve(expected, GAIN_WINDOW, "same")
    steady = STEADY * np.max(share)
    return np.asarray(np.clip(1.0 + beyond / np.maximum(share + steady, 1e-30), 0.0, 1.5))


def _likelihood(
    place: Place, amplitude: Amplitudes, trust: Float
) -> tuple[Float, Float, Float, Float]:
    """Gradient and information of the phase at each node, from all harmonics.

    Also how far each node is trusted next time, and the first harmonic's gain.
    """
    gradient, information = np.zeros(place.nodes), np.zeros(place.nodes)
    new, first_gain = trust, np.ones(place.nodes)
    for k, turn in enumerate(amplitude.turns[:HARMONICS], start=1):
        harmonic = amplitude.harmonic[k - 1]
        weighted = amplitude.weights[k - 1] * harmonic
        left = k * turn * (amplitude.residual @ weighted)
        told = -place.sums(left.imag)
        # The sum over the columns of a wave's square, along the phase: Σ w·(k·Im turn·C)².
        power, turned = (weighted @ harmonic.conj()).real, turn * turn * (weighted @ harmonic)
        expected = place.sums(0.5 * k**2 * (power - turned.real))
        # The columns' noise may go together: what is left of their sum says how much.
        across = place.sums(left.real)
        if expected.sum() <= 0.0:
            continue
        gain = _gain(trust * across, trust * expected)
        total = (trust * expected).sum()
        excess = max(_noise(trust * told, ALONG_HZ), _noise(trust * across, ACROSS_HZ)) / total
        excess = max(excess, 1e-3)
        gradient += gain * trust * told / excess
        information += gain**2 * trust * expected / excess
        if k == 1:
            away = (told**2 + across**2) / np.maximum(expected * excess, 1e-30)
            new, first_gain = (TAILS + 2.0) / (TAILS + away), gain
    return gradient, information, new, first_gain
