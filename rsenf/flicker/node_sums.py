"""Frames grouped by their nearest node, and the sums over them that a fit needs.

The nodes of the phase are a quarter of a second apart. The sufficient statistics of a fit are sums
over the frames around each node: of waves times columns, and of waves times waves. All nodes have
as many places as the fullest one; in places without a frame, waves are zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import NODE_S
from rsenf.flicker.tone import turning

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of one window, in order; times may go back where a frame was repeated.

    Attributes
    ----------
    t_s : ndarray, shape (frames,)
        Times since the window's first node.
    carrier_rad : ndarray, shape (frames,)
        Phase of the nominal illumination frequency.
    columns : ndarray, shape (frames, columns)
        Reduced profiles.
    """

    t_s: Float
    carrier_rad: Float
    columns: Float


def at_frames(t_s: Float, values: Float) -> Float:
    """Interpolate values at nodes linearly.

    Parameters
    ----------
    t_s : ndarray
        Times since the first node, of any shape.
    values : ndarray, shape (nodes,)

    Examples
    --------
    >>> at_frames(np.array([0.125, 0.25]), np.array([0.0, 1.0, 4.0])).tolist()
    [0.5, 1.0]
    """
    left, beyond = _between(t_s, values.size)
    return _linear(values, left, beyond)


@dataclass(frozen=True, eq=False)
class SufficientStatistics:
    """Sums over the frames around each node; the first wave is the constant 1.

    Attributes
    ----------
    columns : ndarray, shape (nodes, waves, columns)
        Sums of waves times columns.
    waves : ndarray, shape (nodes, waves, waves)
        Sums of waves times waves.
    """

    columns: Float
    waves: Float

    def weighted(self, trust: Float) -> SufficientStatistics:
        """Return the sums with the nodes' robust weights, shape (nodes,)."""
        by_node = trust[:, None, None]
        return SufficientStatistics(by_node * self.columns, by_node * self.waves)

    def residuals(self, found: Float) -> Float:
        """Sums of waves times the columns' residuals, shape (nodes, waves, columns).

        ``found`` holds the waves' coefficients in the columns, shape (waves, columns).
        """
        modelled = self.waves.reshape(-1, len(found)) @ found
        return self.columns - modelled.reshape(self.columns.shape)


class Gathered:
    """Frames grouped by their nearest nodes.

    Parameters
    ----------
    frames : Frames
    nodes : int

    Attributes
    ----------
    there : ndarray of bool, shape (nodes, places)
        Whether a place holds a frame.
    columns : ndarray, shape (nodes, places, columns)
    carrier_rad : ndarray, shape (nodes, places)
    carrier_hz, rate_hz : float
        Frequency of the carrier; frame rate.
    """

    def __init__(self, frames: Frames, nodes: int) -> None:
        nearest = np.clip(np.rint(frames.t_s / NODE_S).astype(np.intp), 0, nodes - 1)
        count = np.bincount(nearest, minlength=nodes)
        place = np.empty_like(nearest)  # among the node's frames; times may go back
        by_node = np.argsort(nearest, kind="stable")
        place[by_node] = np.arange(nearest.size) - np.repeat(np.cumsum(count) - count, count)
        self.there = np.arange(max(int(count.max()), 1)) < count[:, None]
        self.columns = np.zeros((*self.there.shape, frames.columns.shape[1]))
        self.columns[nearest, place] = frames.columns
        self.carrier_rad, t_s = np.zeros(self.there.shape), np.zeros(self.there.shape)
        self.carrier_rad[nearest, place], t_s[nearest, place] = frames.carrier_rad, frames.t_s
        lasted_s = max(float(frames.t_s[-1] - frames.t_s[0]), 1e-9)
        turned_rad = float(frames.carrier_rad[-1] - frames.carrier_rad[0])
        self.carrier_hz = turned_rad / (2.0 * np.pi * lasted_s)
        self.rate_hz = 1.0 / max(float(np.median(np.diff(frames.t_s))), 1e-9)
        self._left, self._beyond = _between(t_s, nodes)
        self._place = nearest, place

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self._place[0].size)

    def phase_rad(self, psi_rad: Float) -> Float:
        """Phase at every place, from the nodes' phase relative to the carrier."""
        return self.carrier_rad + _linear(psi_rad, self._left, self._beyond)

    def in_order(self, values: NDArray[np.complex128]) -> Complex:
        """Values of the frames in the order of time, from those at all places."""
        return np.asarray(values[self._place])

    def waves(self, phase_rad: Float, orders: tuple[float, ...]) -> Float:
        """A constant, and cosine and sine of some orders of a phase, shape (nodes, waves, places).

        All are 0 where there is no frame.

        Parameters
        ----------
        phase_rad : ndarray, shape (nodes, places)
        orders : tuple of float
        """
        out = np.empty((self.there.shape[0], 1 + 2 * len(orders), self.there.shape[1]))
        out[:, 0] = self.there
        half = turning(0.5 * phase_rad) if any(order % 1 for order in orders) else None
        first = turning(phase_rad) if half is None else half * half
        powers = [self.there * 1.0, self.there * first]
        for i, order in enumerate(orders):
            while len(powers) <= order:
                powers.append(powers[-1] * first)
            wave = powers[int(order)]
            if half is not None and order % 1:
                wave = wave * half
            out[:, 1 + 2 * i], out[:, 2 + 2 * i] = wave.real, wave.imag
        return out

    def sums(self, waves: Float) -> SufficientStatistics:
        """Sum the frames around each node."""
        return SufficientStatistics(waves @ self.columns, waves @ waves.transpose(0, 2, 1))


def _between(t_s: Float, nodes: int) -> tuple[NDArray[np.intp], Float]:
    """Node to the left of each time, and the distance beyond it in nodes."""
    left = np.clip((t_s / NODE_S).astype(np.intp), 0, nodes - 2)
    return left, t_s / NODE_S - left


def _linear(values: Float, left: NDArray[np.intp], beyond: Float) -> Float:
    return np.asarray(values[left] * (1.0 - beyond) + values[left + 1] * beyond)
