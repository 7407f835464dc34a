"""How many turns the flicker makes down the rows: maximum likelihood, all rows and harmonics.

Under light ``1 + Σ_k Re a_k·exp(j·k·φ)`` row ``l`` of brightness ``B_l`` has the amplitudes
``c_k = B_l·a_k/2·exp(j·k·θ_l)`` with ``θ_l = 2π·q·l/L``: a ramp of ``q`` turns, ``q = f_0·T_ro``,
negative where the last row is read first. Each row's own level is free (it is the texture), and
eliminated from the normal equations by a Schur complement, so that an alias near 0 Hz costs
certainty and makes no error. For given ``q`` the ``a_k`` follow from one small linear system; what
they explain, as a function of ``q``, is the profile likelihood.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.complex_exponential import turning
from rsenf.idle.moments import RIDGE, Moments, orders

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

GRID_STEP = 1 / 16  # turns; the peak of a ramp is two turns wide
GROUPS = 128  # of rows, that are enough to see where the peak is
STEP = 1e-3  # turns, between the points of a parabola
ROUNDS = 12  # of it, at most
REST = 1e-6  # turns: after a step so short there is nothing left to do
THREE = np.array([-STEP, 0.0, STEP])
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
    """The profile likelihood of the turns, of all rows or without some of them.

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
        self._heavy = (brightness**2).astype(np.complex128)
        self._told = brightness * (response - cross[:, None] * moments.row[0] / own)
        self._place = np.arange(brightness.size) / brightness.size

    def coarse(self) -> Profile:
        """Return the profile of some groups of rows: all but as likely, and sooner told."""
        groups = min(GROUPS, self.brightness.size)
        starts = np.arange(groups) * self.brightness.size // groups
        out = copy.copy(self)
        out._heavy, out._told = (
            np.add.reduceat(rows, starts, axis=-1) for rows in (self._heavy, self._told)
        )
        sizes = np.diff(starts, append=self.brightness.size)
        out._place = np.add.reduceat(self._place, starts) / sizes
        return out

    def explained(self, turns: Float) -> Float:
        """Sum of squares that the best amplitudes explain, for each of some turns."""
        return _explained(*self._solve(self._straight(turns), _all))

    def bent(self, turns: float, shapes: Float) -> Float:
        """Return the same for a ramp a little bent, by steps :data:`THREE`: shape (3, shapes).

        Parameters
        ----------
        turns : float
        shapes : ndarray, shape (shapes, rows)
            By how many turns a bend of size 1 changes each row.
        """
        bends = (THREE[:, None, None] * shapes).reshape(-1, self._place.size)
        courses = self._straight(np.array([turns])) + bends
        return _explained(*self._solve(courses, _all)).reshape(3, -1)

    def without_each(self, turns: Float, starts: NDArray[np.int64]) -> Float:
        """Return the same without one band of rows after another, shape (turns, bands).

        Parameters
        ----------
        turns : ndarray, shape (tries,)
        starts : ndarray, shape (bands,)
            First row of each band.
        """

        def others(ramp: Complex, rows: Complex) -> Complex:
            own = np.add.reduceat(ramp * rows, starts, axis=1)
            return np.asarray((own.sum(axis=1, keepdims=True) - own).ravel())

        return _explained(*self._solve(self._straight(turns), others)).reshape(turns.size, -1)

    def amplitude(self, turns: float) -> Complex:
        """``a_k`` of the positive orders."""
        _, found = self._solve(self._straight(np.array([turns])), _all)
        return np.asarray(2.0 * found[0, self.orders > 0])

    def _straight(self, turns: Float) -> Float:
        """Turns at each row of straight ramps, shape (ramps, rows)."""
        return np.outer(turns, self._place)

    def _solve(
        self, courses: Float, added: Callable[[Complex, Complex], Complex]
    ) -> tuple[Complex, Complex]:
        """Right-hand sides and solutions, each (cases, orders).

        ``courses`` are turns at each row, shape (ramps, rows); ``added`` adds up a ramp (ramps,
        rows) times what rows tell (rows,), to (cases,).
        """
        count = self.orders.size
        once = turning(2.0 * np.pi * courses)
        spread, pulls = [], {}
        ramp = np.ones_like(once)  # its powers
        for d in range(count + 1):
            spread.append(added(ramp, self._heavy))
            for i, order in enumerate(self.orders.tolist()):
                if abs(order) == d:
                    own = added(ramp, self._told[i].conj() if order > 0 else self._told[i])
                    pulls[i] = own.conj() if order > 0 else own
            ramp = ramp * once
        pull = np.stack([pulls[i] for i in range(count)], axis=1)
        step = self.orders[None, :] - self.orders[:, None]
        below = np.array(spread)[np.abs(step)]
        ramps = np.where((step < 0)[..., None], below.conj(), below)
        normal = np.moveaxis(self._gram[..., None] * ramps, 2, 0)
        ridge = RIDGE * np.trace(normal, axis1=1, axis2=2).real / count
        normal = normal + ridge[:, None, None] * np.eye(count)
        return pull, np.asarray(np.linalg.solve(normal, pull[..., None])[..., 0], np.complex128)


def _all(ramp: Complex, rows: Complex) -> Complex:
    return np.asarray(ramp @ rows)


def _explained(pull: Complex, amplitude: Complex) -> Float:
    return np.asarray(np.sum(pull.conj() * amplitude, axis=1).real)


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
    first = Profile(moments, 1, brightness).coarse()
    half = int(np.ceil(most_turns / GRID_STEP))
    grid = np.asarray(np.arange(-half, half + 1) * GRID_STEP, np.float64)
    start = float(grid[np.argmax(first.explained(grid))])
    for _ in range(2):
        profile = Profile(moments, moments.harmonics(), brightness)
        start, curvature = climb(profile.explained, start)
        amplitude = profile.amplitude(start)
        brightness = _brightness(moments, amplitude, start)
    return Ramp(start, curvature, amplitude, moments.noise_var(), brightness)


def climb(explained: Callable[[Float], Float], start: float) -> tuple[float, float]:
    """Climb from a start to the top next to it; return the top, and the curvature there.

    Parameters
    ----------
    explained : callable
        Of some turns (tries,), what they explain (tries,).
    start : float
    """
    now, bend = start, 0.0
    for _ in range(ROUNDS):
        move, bent = step_up(explained(now + THREE))
        bend = float(bent)
        new = float(np.clip(now + move, start - FARTHEST, start + FARTHEST))
        moved, now = abs(new - now), new
        if moved < REST:
            break
    return now, bend


def step_up(three: Float) -> tuple[Float, Float]:
    """Step to the top of parabolas through three points each, and their curvatures.

    Parameters
    ----------
    three : ndarray, shape (3, …)
        What turns :data:`THREE` beyond the present ones explain.
    """
    below, here, above = three
    bend = (2.0 * here - below - above) / STEP**2
    slope = (above - below) / (2.0 * STEP)
    # Where it bends upwards the top is some way off, uphill.
    move = np.where(bend > 0, slope / np.where(bend > 0, bend, 1.0), np.sign(slope) * GRID_STEP)
    return np.clip(move, -GRID_STEP, GRID_STEP), bend


def _brightness(moments: Moments, amplitude: Complex, turns: float) -> Float:
    """Each row's own level once the flicker's share of its mean is known."""
    rows = moments.row.shape[1]
    ramp = np.exp(2j * np.pi * turns * np.arange(rows) / rows)
    share = np.zeros(rows)
    for k, a in enumerate(amplitude, 1):
        share += (a * ramp**k * moments.turn[k]).real / moments.frames
    return np.asarray(moments.row[0].real / moments.frames / (1.0 + share))
