"""The phase of a window fitted frame by frame: every sum of the fit written out over the frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import NODE_S, NODES_PER_S, phase_prior
from rsenf.flicker.phase_fit import (
    HALVES,
    LOOK_AFTER,
    MAX_STEPS,
    NEARLY,
    NEARLY_RAD,
    NUISANCES,
    REST,
    REST_RAD,
    STANDS_OUT,
    PhaseFit,
)
from rsenf.flicker.phase_likelihood import (
    ACROSS_HZ,
    ALONG_HZ,
    COLUMNS_HZ,
    FURTHER_SIZE,
    GAIN_WINDOW,
    HARMONIC_SIZE,
    HARMONICS,
    RIDGE,
    SIGNIFICANT,
    STEADY,
    TAILS,
    WindowFrames,
)

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]


def fit_by_frames(frames: WindowFrames, psi_rad: Float) -> PhaseFit:
    """Most probable phase near a first guess."""
    grid = phase_prior(psi_rad.size)
    prior = grid.basis
    place = _Place(frames.t_s, psi_rad.size)
    coefficient = np.linalg.lstsq(prior, psi_rad, rcond=1e-9)[0]
    trust = np.ones(psi_rad.size)
    orders: tuple[float, ...] = tuple(range(1, HARMONICS + 1))
    settled = False
    for done in range(MAX_STEPS):
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
        limits = (REST, REST_RAD) if settled else (NEARLY, NEARLY_RAD)
        near = far < limits[0] or farthest < limits[1]
        if settled and near:
            break
        if not settled and (near or done == LOOK_AFTER):
            settled = True
            more = _nuisances(place, amplitude)
            orders += more
            if set(more) & set(HALVES):
                trust = np.ones(psi_rad.size)
    psi = prior @ coefficient
    over_second = (prior[NODES_PER_S:] - prior[:-NODES_PER_S]) / (2.0 * np.pi)
    solved = np.linalg.solve(precision, over_second.T)
    return PhaseFit(
        psi_rad=psi,
        second_var_hz2=np.einsum("ij,ji->i", over_second, solved) + grid.left_out_hz2,
        template=amplitude.harmonic[0],
        weights=amplitude.weights[0],
        information=information,
        gain=gain,
        t_s=frames.t_s,
        deviation=_deviation(frames, place, psi, amplitude),
        second_ratio=float(np.linalg.norm(amplitude.harmonic[1]))
        / max(float(np.linalg.norm(amplitude.harmonic[0])), 1e-30),
    )


class _Place:
    """Where the frames, in the order of time, lie between the nodes."""

    def __init__(self, t_s: Float, nodes: int) -> None:
        self.nodes = nodes
        self._left = np.clip((t_s / NODE_S).astype(np.intp), 0, nodes - 2)
        self._beyond = t_s / NODE_S - self._left
        self._nearest = np.clip(np.rint(t_s / NODE_S).astype(np.intp), 0, nodes - 1)

    def at_frames(self, values: Float) -> Float:
        """Values at nodes, linear in between, at the frames."""
        return values[self._left] * (1.0 - self._beyond) + values[self._left + 1] * self._beyond

    def of_nodes(self, values: Float) -> Float:
        """Value of the nearest node, at the frames."""
        return np.asarray(values[self._nearest])

    def sums(self, values: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Sum over the frames nearest to each node, shape (nodes, …)."""
        out = np.zeros((self.nodes, *values.shape[1:]), values.dtype)
        for node, value in zip(self._nearest, values, strict=True):
            out[node] += value
        return out


@dataclass(frozen=True, eq=False)
class _Amplitudes:
    """``harmonic[k−1]`` is ``C_k`` (columns,), ``weights[k−1]`` one over its columns' noise."""

    harmonic: list[Complex]
    weights: list[Float]
    turns: list[Complex]  # exp(j·k·φ) at the frames
    residual: Float  # (frames, columns)
    phase: Float  # at the frames
    orders: tuple[float, ...]
    found: Float


def _amplitudes(
    frames: WindowFrames, place: _Place, psi: Float, trust: Float, orders: tuple[float, ...]
) -> _Amplitudes:
    phase = frames.carrier_rad + place.at_frames(psi)
    turns = [np.exp(1j * k * phase) for k in orders]
    weight = place.of_nodes(trust)
    design = _design(turns)
    weighted = design * weight[:, None]
    gram = weighted.T @ design
    ridge = np.repeat(
        [RIDGE * phase.size / HARMONIC_SIZE.get(k, FURTHER_SIZE) ** 2 for k in orders], 2
    )
    gram.flat[:: len(gram) + 1] += np.concatenate([[0.0], ridge])
    found = np.linalg.solve(gram, weighted.T @ frames.columns)
    residual = frames.columns - design @ found
    harmonic, weights = [], []
    for k, turn in enumerate(turns[:HARMONICS]):
        raw = found[1 + 2 * k] - 1j * found[2 + 2 * k]
        noise = _noise(place.sums(residual * (weight * turn.conj())[:, None])) / weight.sum()
        noise = np.maximum(noise, 1e-6 * noise.max() + 1e-12)
        doubt = SIGNIFICANT * 4.0 * noise / phase.size
        shrink = np.maximum(0.0, 1.0 - doubt / np.maximum(np.abs(raw) ** 2, 1e-30))
        harmonic.append(raw * shrink)
        weights.append(1.0 / noise)
    return _Amplitudes(harmonic, weights, turns, residual, phase, orders, found)


def _nuisances(place: _Place, amplitude: _Amplitudes) -> tuple[float, ...]:
    """Further harmonics that stand out in some column."""
    out = []
    for k in (*range(HARMONICS + 1, NUISANCES + 1), *HALVES):
        turn = np.exp(-1j * k * amplitude.phase)[:, None]
        demodulated = amplitude.residual * turn
        power = np.abs(demodulated.sum(axis=0)) ** 2
        if np.any(power > STANDS_OUT * _noise(place.sums(demodulated))):
            out.append(k)
    return tuple(out)


def _noise(series: Float | Complex, band_hz: tuple[float, float] = COLUMNS_HZ) -> Float:
    """Power of a node series' transform near, but not at, 0 Hz; shape as one row."""
    away = np.abs(np.fft.fftfreq(series.shape[0], NODE_S))
    among = (away >= band_hz[0]) & (away <= band_hz[1])
    power = np.abs(np.fft.fft(series, axis=0)[among]) ** 2
    return np.asarray(np.median(power, axis=0) / np.log(2.0))


def _deviation(frames: WindowFrames, place: _Place, psi: Float, amplitude: _Amplitudes) -> Complex:
    """What the model leaves of the frames at the last phase, relative to the first harmonic."""
    weighted = amplitude.weights[0] * amplitude.harmonic[0].conj()
    power = float(np.sum(weighted * amplitude.harmonic[0]).real)
    phase = frames.carrier_rad + place.at_frames(psi)
    if power <= 0.0:
        return np.zeros(phase.size, np.complex128)
    left = (
        frames.columns
        - _design([np.exp(1j * k * phase) for k in amplitude.orders]) @ amplitude.found
    )
    return np.asarray(2.0 * (left @ weighted) * np.exp(-1j * phase) / power)


def _design(turns: list[Complex]) -> Float:
    """Waves at the frames: a constant, then cosine and sine of each order."""
    parts = [part for turn in turns for part in (turn.real, turn.imag)]
    return np.column_stack([np.ones(turns[0].size), *parts])


def _gain(across: Float, expected: Float) -> Float:
    """Size of the flicker around each node relative to the window's, at most one and a half."""
    beyond = np.convolve(across, GAIN_WINDOW, "same")
    share = np.convolve(expected, GAIN_WINDOW, "same")
    steady = STEADY * np.max(share)
    return np.asarray(np.clip(1.0 + beyond / np.maximum(share + steady, 1e-30), 0.0, 1.5))


def _likelihood(
    place: _Place, amplitude: _Amplitudes, trust: Float
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
