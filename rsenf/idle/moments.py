"""Sums over frames from which every row's flicker can be solved, in memory that doesn't grow.

A row's level is ``y[n] = Σ_k c_k·exp(j·k·ψ_n)`` for ``k`` from ``−K`` to ``K`` and noise, where
``ψ_n`` is the flicker's phase at frame ``n``, ``c_0`` the row's own level, and ``c_{−k}`` the
conjugate of ``c_k``. Its least squares need ``r_k = Σ_n y[n]·exp(−j·k·ψ_n)`` and the Gram matrix
``G_km = Σ_n exp(j·(m−k)·ψ_n)``, which is the same for all rows and depends on ``m − k`` alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.complex_exponential import turning

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

HARMONICS = 3
# A harmonic that turns so little counts for nothing: what changes slowly in a scene is as slow.
MOST_STILL = 0.3
RIDGE = 1e-9  # of what is on a Gram matrix's diagonal, where harmonics can't be told apart


class Moments:
    """What frames have told so far.

    Parameters
    ----------
    rows : int

    Attributes
    ----------
    frames : int
        Frames that count.
    turn : ndarray of complex, shape (2·K + 1,)
        ``Σ_n exp(j·d·ψ_n)`` for ``d`` from 0 to ``2·K``.
    row : ndarray of complex, shape (K + 1, rows)
        ``r_k`` of each row, ``k`` from 0 to ``K``.
    contrast : ndarray, shape (rows - 1,)
        ``Σ_n (y[n] of the next row − y[n])²``: what neighbours don't share is noise.
    """

    def __init__(self, rows: int) -> None:
        self.frames = 0
        self.turn = np.zeros(2 * HARMONICS + 1, np.complex128)
        self.row = np.zeros((HARMONICS + 1, rows), np.complex128)
        self.contrast = np.zeros(rows - 1)

    def add(self, phase_rad: Float, level: Float) -> None:
        """Add frames.

        Parameters
        ----------
        phase_rad : ndarray, shape (frames,)
        level : ndarray, shape (frames, rows)
        """
        waves = turning(np.arange(2 * HARMONICS + 1)[:, None] * phase_rad)
        self.frames += phase_rad.size
        self.turn += waves.sum(axis=1)
        # Real products: a complex one would make all the levels complex first.
        own = waves[: HARMONICS + 1]
        self.row.real += own.real @ level
        self.row.imag -= own.imag @ level
        step = level[:, 1:] - level[:, :-1]
        self.contrast += np.einsum("nl,nl->l", step, step)

    def gram(self, orders: NDArray[np.int64]) -> Complex:
        """Gram matrix of some orders ``k``, shape (orders, orders)."""
        step = orders[None, :] - orders[:, None]
        below = self.turn[np.abs(step)]
        return np.asarray(np.where(step < 0, below.conj(), below))

    def response(self, orders: NDArray[np.int64]) -> Complex:
        """``r_k`` of some orders, shape (orders, rows)."""
        found = self.row[np.abs(orders)]
        return np.asarray(np.where(orders[:, None] < 0, found.conj(), found))

    def harmonics(self) -> int:
        """How many harmonics turn beside the texture, from the first on; 1 at least.

        Of light at 50 Hz the third, at 30 frames a second, goes as slowly as the grid's deviation.
        """
        turned = np.abs(self.turn[2 : HARMONICS + 1]) < MOST_STILL * self.frames
        return 1 + int(np.argmin(np.append(turned, False)))

    def noise_var(self) -> float:
        """Mean variance of a row's level about its own fit, from the differences of neighbours.

        Flicker beyond the fitted harmonics is the same in both, and no noise.
        """
        every = np.append(orders(HARMONICS), 0)
        response = np.diff(self.response(every), axis=1)
        gram = self.gram(every) + RIDGE * self.frames * np.eye(every.size)
        told = np.sum(response.conj() * np.linalg.solve(gram, response), axis=0).real
        freedom = max(self.frames - every.size, 1)
        return float(np.mean(np.maximum(self.contrast - told, 0.0))) / 2.0 / freedom

    def still_ratio(self) -> float:
        """How far the flicker stood still, or went to and fro by half a turn: 0 to 1.

        At 1 nothing tells it from texture, or one sense of rotation from the other.
        """
        return float(np.max(np.abs(self.turn[1:3]))) / self.frames if self.frames else 1.0


def orders(harmonics: int) -> NDArray[np.int64]:
    """Orders ``±1 … ±harmonics``."""
    up = np.arange(1, harmonics + 1)
    return np.concatenate((-up[::-1], up))
