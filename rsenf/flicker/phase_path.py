"""The phase known so far, at the nodes of consecutive seconds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import NODES_PER_S

Float = NDArray[np.float64]


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
