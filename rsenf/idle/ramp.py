"""How many turns the flicker makes down the rows: maximum likelihood, all rows and harmonics.

Under light ``1 + Σ_k Re a_k·exp(j·k·φ)`` row ``l`` of brightness ``B_l`` has the amplitudes
``c_k = B_l·a_k/2·exp(j·k·θ_l)`` with ``θ_l = 2π·q·l/L``: a ramp of ``q`` turns, ``q = f_0·T_ro``,
negative where the last row is read first. Each row's own level is free (it is the texture), and
eliminated from the normal equations by a Schur complement, so that an alias near 0 Hz costs
certainty and makes no error. For given ``q`` the ``a_k`` follow from one small linear system; what
they explain, as a function of ``q``, is the profile likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.turning import turning
from rsenf.idle.moments import HARMONICS, RIDGE, Moments, orders

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

GRID_STEP = 1 / 16  # turns; the peak of a ramp is two turns wide
STEP = 1e-3  # turns, between the points of a parabola
ROUNDS = 12  # of it, at most
FARTHEST = 0.5  # turns that the refinement may go from where it begins


@dataclass(frozen=True, eq=False)
class Ramp:
    """The most likely ramp.

    Parameters
    ----------
    turns : float
    curvature : float
        Minus the second derivative of what is explained (levels², summed over frames), by turns.
    amplitude : ndarray of complex, shape (harmonics,)
        ``a_k``, relative to the mean light.
    noise_var : float
        Variance of a row's level by noise, levels².
    brightness : ndarray, shape (rows,)
        ``B_l``: each row's own level.
    """

    turns: float
    curvature: float
    amplitude: Complex
    noise_var: float
    brightness: Float

    @property
    def flicker_ratio(self) -> float:
        """Size of the first harmonic."""
        return float(np.abs(self.amplitude[0]))

    @property
    def bound_var(self) -> float:
        """Variance of the turns if nothing but white noise disturbs them (Cramér–Rao)."""
        return 2.0 * self.noise_var / self.curvature if self.curvature > 0 else np.inf


class Profile:
    """The profile likelihood of the turns, for any weighting of the rows.

    Parameters
    ----------
    moments : Moments
    harmonics : int
        How many are explained together.
    brightness : ndarray, shape (rows,)
        ``B_l``.
    """

    def __init__(self, moments: Moments, harmonics: int, brightness: Float) -> None:
        self.orders = orders(harmonics)
        self.brightness = brightness
        level = moments.gram(np.append(self.orders, 0))
        inner, cross, own = level[:-1, :-1], level[:-1, -1], level[-1, -1].real
        response = moments.response(self.orders)
        self._gram = inner - np.outer(cross, cross.conj()) / own
        self._response = response - cross[:, None] * moments.row[0] / own

    def explained(self, turns: Float, weight: Float) -> Float:
        """Sum of squares that the best amplitudes explain.

        Parameters
        ----------
        turns : ndarray, shape (tries,)
        weight : ndarray, shape (tries, rows) or (1, rows)

        Returns
        -------
        ndarray, shape (tries,)
        """
        pull, amplitude = self._solve(turns, weight)
        return np.asarray(np.sum(pull.conj() * amplitude, axis=1).real)

    def amplitude(self, turns: float) -> Complex:
        """``a_k`` of the positive orders, all rows weighing the same."""
        _, found = self._solve(np.array([turns]), np.ones((1, self.brightness.size)))
        return np.asarray(2.0 * found[0, self.orders > 0])

    def _solve(self, turns: Float, weight: Float) -> tuple[Complex, Complex]:
        """Right-hand sides and solutions, each (tries, orders)."""
        rows, count = self.brightness.size, self.orders.size
        once = turning(2.0 * np.pi * np.outer(turns, np.arange(rows) / rows))
        heavy, told = self.brightness**2, self.brightness * self._response
        spread = np.empty((count + 1, turns.size), np.complex128)
        pull = np.empty((turns.size, count), np.complex128)
        weighted = weight * np.ones_like(once)  # the weights times the ramp's powers
        for d in range(count + 1):
            spread[d] = weighted @ heavy
            for i in np.flatnonzero(np.abs(self.orders) == d):
                down = self.orders[i] > 0
                own = weighted @ (told[i].conj() if down else told[i])
                pull[:, i] = own.conj() if down else own
            weighted = weighted * once
        step = self.orders[None, :] - self.orders[:, None]
        ramps = np.where((step < 0)[..., None], spread[np.abs(step)].conj(), spread[np.abs(step)])
        normal = np.moveaxis(self._gram[..., None] * ramps, 2, 0)
        ridge = RIDGE * np.trace(normal, axis1=1, axis2=2).real / count
        normal = normal + ridge[:, None, None] * np.eye(count)
        return pull, np.asarray(np.linalg.solve(normal, pull[..., None])[..., 0], np.complex128)


def find_ramp(moments: Moments, most_turns: float) -> Ramp:
    """Find the most likely ramp among those no steeper than a limit, in both directions.

    The first harmonic alone says where: where a harmonic's alias falls on the first's, it could
    play the first's part at another ramp. Then all of them say exactly where.

    Parameters
    ----------
    moments : Moments
    most_turns : float
    """
    brightness = moments.row[0].real / moments.frames
    even = np.ones((1, brightness.size))
    first = Profile(moments, 1, brightness)
    half = int(np.ceil(most_turns / GRID_STEP))
    grid = np.asarray(np.arange(-half, half + 1) * GRID_STEP, np.float64)
    start = float(grid[np.argmax(first.explained(grid, even))])
    for _ in range(2):
        profile = Profile(moments, HARMONICS, brightness)
        turns, curvature = climb(profile, np.array([start]), even)
        start = float(turns[0])
        amplitude = profile.amplitude(start)
        brightness = _brightness(moments, amplitude, start)
    return Ramp(start, float(curvature[0]), amplitude, moments.noise_var(), brightness)


def climb(profile: Profile, turns: Float, weight: Float) -> tuple[Float, Float]:
    """Climb from each start to the top next to it; return tops and curvatures there.

    Parameters
    ----------
    turns : ndarray, shape (tries,)
    weight : ndarray, shape (tries, rows) or (1, rows)
    """
    start, now, bend = turns, turns, np.zeros(turns.size)
    for _ in range(ROUNDS):
        below, here, above = (profile.explained(now + d, weight) for d in (-STEP, 0.0, STEP))
        bend = (2.0 * here - below - above) / STEP**2
        slope = (above - below) / (2.0 * STEP)
        # Where it bends upwards the top is some way off, uphill.
        move = np.where(bend > 0, slope / np.where(bend > 0, bend, 1.0), np.sign(slope) * GRID_STEP)
        new = np.clip(
            now + np.clip(move, -GRID_STEP, GRID_STEP), start - FARTHEST, start + FARTHEST
        )
        moved, now = np.max(np.abs(new - now)), new
        if moved < 1e-9:
            break
    return now, bend


def _brightness(moments: Moments, amplitude: Complex, turns: float) -> Float:
    """Each row's own level once the flicker's share of its mean is known."""
    rows = moments.row.shape[1]
    ramp = np.exp(2j * np.pi * turns * np.arange(rows) / rows)
    share = np.zeros(rows)
    for k, a in enumerate(amplitude, 1):
        share += (a * ramp**k * moments.turn[k]).real / moments.frames
    return np.asarray(moments.row[0].real / moments.frames / (1.0 + share))
