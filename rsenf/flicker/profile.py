"""Reduces a frame's row profile to the few coefficients in which flicker can show.

A harmonic of the flicker is a phase ramp down the rows, of a non-integer number of turns, which the
scene's reflectance modulates. Both are smooth: a few cosines and sines down the rows represent
them, whatever the read-out time is. These are real and orthogonal, so that white noise of the rows
stays white, and a tone's mirror image at the negative frequency shows by its ramp the other way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import RowBlock

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Turns kept beyond those of the fastest ramp, for its modulation by texture.
SPARE_TURNS = 2
TURNS_STEP = 0.05


class ProfileBasis:
    """Cosines and sines of 0 … M turns down the rows, scaled to mean square one.

    Parameters
    ----------
    rows : int
    max_turns : float
        Most turns of any harmonic down one frame.

    Examples
    --------
    >>> basis = ProfileBasis(100, 4.0)
    >>> round(basis.turns_of(basis.ramps(np.array([2.5]))[:, 0]), 3)
    2.5
    """

    def __init__(self, rows: int, max_turns: float) -> None:
        self.rows = rows
        most = min(int(np.ceil(max_turns)) + SPARE_TURNS, (rows - 1) // 2)
        angle = 2.0 * np.pi * np.outer((np.arange(rows) + 0.5) / rows, np.arange(1, most + 1))
        waves = np.sqrt(2.0) * np.hstack([np.cos(angle), np.sin(angle)])
        self._waves = np.hstack([np.ones((rows, 1)), waves])
        count = int(np.ceil(max_turns / TURNS_STEP))
        self._turns: Float = np.asarray(np.arange(-count, count + 1) * TURNS_STEP, np.float64)
        self._grid = self.ramps(self._turns)
        self._grid_power = np.sum(np.abs(self._grid) ** 2, axis=0)

    @property
    def columns(self) -> int:
        """Number of coefficients per frame."""
        return int(self._waves.shape[1])

    def reduce(self, block: RowBlock) -> Float:
        """Coefficients of every frame of a block, shape (frames, columns); strips are averaged.

        Frame by frame, so that the division into blocks doesn't change a bit of the result.
        """
        profile = block.profiles()
        return np.asarray((profile[:, None, :] @ self._waves)[:, 0, :] / self.rows)

    def ramps(self, turns: Float) -> Complex:
        """Coefficients of ramps ``exp(j·2π·turns·x)`` down the frame, shape (columns, ramps)."""
        place = (np.arange(self.rows) + 0.5) / self.rows
        angle = 2.0 * np.pi * np.outer(place, turns)
        # Real products: a complex one would first convert all the waves to complex.
        return np.asarray(
            (self._waves.T @ np.cos(angle) + 1j * (self._waves.T @ np.sin(angle))) / self.rows
        )

    def lit(self, texture: Float, turns: Float) -> tuple[Complex, Complex]:
        """Coefficients of ramps times a texture, and their derivatives by the turns.

        Parameters
        ----------
        texture : ndarray, shape (columns,)
            Coefficients of the texture.
        turns : ndarray, shape (ramps,)

        Returns
        -------
        columns, derivatives : ndarray of complex, shape (ramps, columns)
        """
        place = (np.arange(self.rows) + 0.5) / self.rows
        scene = self._waves @ texture / self.rows
        angle = 2.0 * np.pi * np.outer(turns, place)
        cosine, sine = np.cos(angle) * scene, np.sin(angle) * scene
        later = 2.0 * np.pi * place
        parts = np.concatenate([cosine, sine, -later * sine, later * cosine]) @ self._waves
        real, imag, real_by, imag_by = np.split(parts, 4)
        return real + 1j * imag, real_by + 1j * imag_by

    def turns_of(self, template: Complex) -> float:
        """Turns of the ramp that best matches a template, shape (columns,)."""
        power = np.abs(template.conj() @ self._grid) ** 2 / self._grid_power
        peak = min(max(int(power.argmax()), 1), power.size - 2)
        a, b, c = power[peak - 1 : peak + 2].tolist()
        bend = a - 2.0 * b + c
        beyond = 0.5 * (a - c) / bend if bend < 0.0 else 0.0
        return float(self._turns[peak]) + TURNS_STEP * min(max(beyond, -1.0), 1.0)
