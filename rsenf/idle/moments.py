"""Sums over frames that determine every row's flicker, in constant memory.

A row's level is ``y[n] = Σ_k c_k·exp(j·k·ψ_n)`` for ``k`` from ``−K`` to ``K`` and noise, where
``ψ_n`` is the flicker's phase at frame ``n``, ``c_0`` the row's own level, and ``c_{−k}`` the
conjugate of ``c_k``. Its least squares need ``r_k = Σ_n y[n]·exp(−j·k·ψ_n)`` and the Gram matrix
``G_km = Σ_n exp(j·(m−k)·ψ_n)``, which is the same for all rows and depends on ``m − k`` alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.tone import turning

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

HARMONICS = 3
# Harmonics whose mean phasor is longer aren't used: slow changes of the scene look like them.
MOST_STILL = 0.3
RIDGE = 1e-9  # of a Gram matrix's diagonal, for harmonics that aren't separable


class Moments:
    """Sufficient statistics of the frames so far.

    Parameters
    ----------
    rows : int

    Attributes
    ----------
    frames : int
        Number of frames.
    turn : ndarray of complex, shape (2·K + 1,)
        ``Σ_n exp(j·d·ψ_n)`` for ``d`` from 0 to ``2·K``.
    row : ndarray of complex, shape (K + 1, rows)
        ``r_k`` of each row, ``k`` from 0 to ``K``.
    contrast : ndarray, shape (rows - 1,)
        ``Σ_n (y[n] of the next row − y[n])²``: neighbours differ by noise.
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
        # Real products: a complex one would first convert all the levels to complex.
        fitted = waves[: HARMONICS + 1]
        self.row.real += fitted.real @ level
        self.row.imag -= fitted.imag @ level
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
        """Number of harmonics, from the first on, that turn relative to the texture; at least 1.

        At 30 frames/s the third one of light at 50 Hz is as slow as the grid's deviation.
        """
        turned = np.abs(self.turn[2 : HARMONICS + 1]) < MOST_STILL * self.frames
        return 1 + int(np.argmin(np.append(turned, False)))

    def noise_var(self) -> float:
        """Mean variance of a row's level about its fit, from the differences of neighbours.

        Flicker beyond the fitted harmonics is the same in both, and cancels.
        """
        every = np.append(orders(HARMONICS), 0)
        response = np.diff(self.response(every), axis=1)
        gram = self.gram(every) + RIDGE * self.frames * np.eye(every.size)
        explained = np.sum(response.conj() * np.linalg.solve(gram, response), axis=0).real
        freedom = max(self.frames - every.size, 1)
        return float(np.mean(np.maximum(self.contrast - explained, 0.0))) / 2.0 / freedom

    def still_ratio(self) -> float:
        """Length of the mean phasor, or of the mean of its square if larger: 0 to 1.

        At 1 the flicker is static, or alternates by half a turn: it isn't separable from texture,
        or one sense of rotation from the other.
        """
        return float(np.max(np.abs(self.turn[1:3]))) / self.frames if self.frames else 1.0


def orders(harmonics: int) -> NDArray[np.int64]:
    """Orders ``±1 … ±harmonics``.

    >>> orders(2).tolist()
    [-2, -1, 1, 2]
    """
    up = np.arange(1, harmonics + 1)
    return np.concatenate((-up[::-1], up))
