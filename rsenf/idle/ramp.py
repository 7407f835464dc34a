"""Maximum-likelihood ramp of the flicker down the rows, from all rows and harmonics.

Model: under light ``1 + Σ_k Re a_k·exp(j·k·φ)`` and white noise, row ``l`` of brightness ``B_l``
has the amplitudes ``c_k = B_l·a_k/2·exp(j·k·θ_l)`` with ``θ_l = 2π·q·l/L``: a ramp of ``q`` turns,
``q = f_0·T_ro``, negative if the last row is read first.

Likelihood: Gaussian. Each row's own level is free (it is the texture), and eliminated from the
normal equations by a Schur complement, so that an alias near 0 Hz costs precision and causes no
bias. For given ``q`` the ``a_k`` follow from one small linear system; the sum of squares that they
explain, as a function of ``q``, is the profile likelihood.

Approximate: ``B_l`` is taken from the row's mean, less the flicker's share. A codec's errors aren't
white noise: they are on its blocks of rows, last as long as the clip, and lean the same way over
several blocks. So the ramp is estimated again with one band of rows after another left out
(jackknife), and the rows' deviation from one line gives the possible error of the line itself.

References
----------
- Golub, G. H. and Pereyra, V. (1973), The differentiation of pseudo-inverses and nonlinear least
  squares problems whose variables separate, SIAM J. Numer. Anal. 10, 413.
- Efron, B. and Stein, C. (1981), The jackknife estimate of variance, Annals of Statistics 9, 586.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.tone import turning
from rsenf.idle.moments import RIDGE, Moments, orders

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

GRID_STEP = 1 / 16  # turns; the peak of a ramp is two turns wide
GROUPS = 128  # of rows, enough to find the peak
STEP = 1e-3  # turns between the points of a parabola
ROUNDS = 12  # most parabolas
REST = 1e-6  # turns; a shorter step is the last
THREE = np.array([-STEP, 0.0, STEP])
FARTHEST = 0.5  # turns from the start that the refinement may go


@dataclass(frozen=True, eq=False)
class Ramp:
    """The most likely ramp.

    Parameters
    ----------
    turns : float
    curvature : float
        Minus the second derivative of the explained sum of squares (levels²) by turns.
    amplitude : ndarray of complex, shape (harmonics,)
        ``a_k``, relative to the mean light.
    noise_var : float
        Noise variance of a row's level, levels².
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
        """Amplitude of the first harmonic, relative to the mean light."""
        return float(np.abs(self.amplitude[0]))

    @property
    def bound_var(self) -> float:
        """Cramér-Rao bound of the turns' variance, in white noise (Rife and Boorstyn 1974)."""
        return 2.0 * self.noise_var / self.curvature if self.curvature > 0 else np.inf


class Profile:
    """Profile likelihood of the turns, from all rows or without some of them.

    Parameters
    ----------
    moments : Moments
    harmonics : int
        Number of harmonics fitted jointly.
    brightness : ndarray, shape (rows,)
        ``B_l``.
    """

    def __init__(self, moments: Moments, harmonics: int, brightness: Float) -> None:
        self.orders = orders(harmonics)
        self.brightness = brightness
        level = moments.gram(np.append(self.orders, 0))
        inner, cross, constant = level[:-1, :-1], level[:-1, -1], level[-1, -1].real
        response = moments.response(self.orders)
        self._gram = inner - np.outer(cross, cross.conj()) / constant
        self._heavy = (brightness**2).astype(np.complex128)
        self._rhs = brightness * (response - cross[:, None] * moments.row[0] / constant)
        self._place = np.arange(brightness.size) / brightness.size

    def coarse(self) -> Profile:
        """Return the profile from groups of rows: nearly as accurate, and faster."""
        groups = min(GROUPS, self.brightness.size)
        starts = np.arange(groups) * self.brightness.size // groups
        out = copy.copy(self)
        out._heavy, out._rhs = (
            np.add.reduceat(rows, starts, axis=-1) for rows in (self._heavy, self._rhs)
        )
        sizes = np.diff(starts, append=self.brightness.size)
        out._place = np.add.reduceat(self._place, starts) / sizes
        return out

    def explained(self, turns: Float) -> Float:
        """Sum of squares that the best amplitudes explain, by turns (Golub and Pereyra 1973)."""
        return _explained(*self._solve(self._straight(turns), _all))

    def bent(self, turns: float, shapes: Float) -> Float:
        """Explained sum of squares of a slightly bent ramp, by steps :data:`THREE`: (3, shapes).

        Parameters
        ----------
        turns : float
        shapes : ndarray, shape (shapes, rows)
            Turns that a bend of size 1 adds at each row.
        """
        bends = (THREE[:, None, None] * shapes).reshape(-1, self._place.size)
        courses = self._straight(np.array([turns])) + bends
        return _explained(*self._solve(courses, _all)).reshape(3, -1)

    def without_each(self, turns: Float, starts: NDArray[np.int64]) -> Float:
        """Explained sum of squares without one band of rows after another, shape (turns, bands).

        Parameters
        ----------
        turns : ndarray, shape (tries,)
        starts : ndarray, shape (bands,)
            First row of each band.
        """

        def others(ramp: Complex, rows: Complex) -> Complex:
            of_band = np.add.reduceat(ramp * rows, starts, axis=1)
            return np.asarray((of_band.sum(axis=1, keepdims=True) - of_band).ravel())

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

        ``courses`` are turns at each row, shape (ramps, rows); ``added`` sums a ramp (ramps, rows)
        times the rows' statistics (rows,), to (cases,).
        """
        count = self.orders.size
        once = turning(2.0 * np.pi * courses)
        spread, pulls = [], {}
        ramp = np.ones_like(once)  # its powers
        for d in range(count + 1):
            spread.append(added(ramp, self._heavy))
            for i, order in enumerate(self.orders.tolist()):
                if abs(order) == d:
                    term = added(ramp, self._rhs[i].conj() if order > 0 else self._rhs[i])
                    pulls[i] = term.conj() if order > 0 else term
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
    """Find the most likely ramp up to a steepness, in both directions.

    The first harmonic alone finds the peak: a harmonic with the first one's alias could take its
    place at another ramp. Then all of them refine it.

    Parameters
    ----------
    moments : Moments
    most_turns : float
        Steepest ramp.
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
    """Climb from a start to the nearest maximum; return it, and the curvature there.

    Parameters
    ----------
    explained : callable
        Explained sums of squares (tries,) as a function of turns (tries,).
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
    """Step to the vertex of parabolas through three points each, and their curvatures.

    Parameters
    ----------
    three : ndarray, shape (3, …)
        Explained sums of squares at turns :data:`THREE` from the present ones.
    """
    below, here, above = three
    bend = (2.0 * here - below - above) / STEP**2
    slope = (above - below) / (2.0 * STEP)
    # Where it is convex the maximum is some way off, uphill.
    move = np.where(bend > 0, slope / np.where(bend > 0, bend, 1.0), np.sign(slope) * GRID_STEP)
    return np.clip(move, -GRID_STEP, GRID_STEP), bend


def segment_turns(segments: Sequence[Moments], ramp: Ramp) -> Float:
    """Turns of the ramp in each segment of a stream; those too short are left out.

    Parameters
    ----------
    segments : sequence of Moments
    ramp : Ramp
        Of the whole stream.
    """
    found = []
    for part in segments:
        if 2 * part.frames > segments[0].frames:
            harmonics = min(part.harmonics(), ramp.amplitude.size)
            profile = Profile(part, harmonics, ramp.brightness).coarse()
            found.append(climb(profile.explained, ramp.turns)[0])
    return np.array(found)


def _brightness(moments: Moments, amplitude: Complex, turns: float) -> Float:
    """Each row's own level, given the flicker's share of its mean."""
    rows = moments.row.shape[1]
    ramp = np.exp(2j * np.pi * turns * np.arange(rows) / rows)
    share = np.zeros(rows)
    for k, a in enumerate(amplitude, 1):
        share += (a * ramp**k * moments.turn[k]).real / moments.frames
    return np.asarray(moments.row[0].real / moments.frames / (1.0 + share))


BAND_ROWS = 48  # three macroblocks of H.264
MIN_BANDS = 10
BENDS = 7  # polynomials: from the straight line on, up to what a tenth of the rows resolves
NEAR = 0.02  # turns, up to which one step is enough: the peak is two turns wide


def bands(rows: int) -> NDArray[np.int64]:
    """First row of each band."""
    count = min(max(rows // BAND_ROWS, MIN_BANDS), rows)
    return np.arange(count) * rows // count


def left_out(rows: int) -> Float:
    """Weights that leave out one band each, shape (bands, rows)."""
    starts = bands(rows)
    band = np.searchsorted(starts, np.arange(rows), side="right") - 1
    return np.asarray(band[None, :] != np.arange(starts.size)[:, None], np.float64)


def jackknife_var(profile: Profile, turns: float) -> float:
    """Variance of the turns by leaving out bands of rows (Efron and Stein 1981).

    Mostly the maximum without a band is close to that of all rows: one step from there is exact to
    such a high order that all bands can share its sums.

    Parameters
    ----------
    profile : Profile
    turns : float
        Maximum of all rows.
    """
    starts = bands(profile.brightness.size)
    move, _ = step_up(profile.without_each(turns + THREE, starts))
    without = turns + move
    for band in np.flatnonzero(np.abs(move) > NEAR):
        without[band], _ = climb(partial(_without, profile, starts, int(band)), turns)
    return float((starts.size - 1) * np.var(without))


def bends(weight: Float) -> Float:
    """Polynomials down the rows from the straight line on, shape (orders, rows).

    Orthogonal under the rows' weights, and scaled to the size of the straight line.
    """
    root = np.sqrt(np.maximum(weight, 1e-12))[:, None]  # black rows have none
    place = (np.arange(weight.size) + 0.5) / weight.size
    shapes, size = np.linalg.qr(np.vander(place, BENDS + 1, increasing=True) * root)
    return np.asarray((shapes / root * size[1, 1]).T[1:])


def bend_var(profile: Profile, turns: float) -> float:
    """Variance of the turns if the phases have a slope as large as their bends.

    Errors that lean the same way over many rows affect neighbouring bands alike, and the jackknife
    underestimates them. Their slope is taken for read-out; their higher polynomials aren't, and are
    taken to be as large each. White noise makes all of them, and so the variance, equal the bound.

    Parameters
    ----------
    profile : Profile
    turns : float
        Maximum of all rows.
    """
    move, bend = step_up(profile.bent(turns, bends(profile.brightness**2)))
    return float(np.mean(move[1:] ** 2 * np.maximum(bend[1:], 0.0)) / bend[0])


def freedom(rows: int) -> float:
    """Degrees of freedom of the jackknife's variance (Satterthwaite's) (Satterthwaite 1946).

    Bands act on a slope by the square of their distance from the middle: ``(Σx²)²/Σx⁴``.
    """
    return 5.0 / 9.0 * bands(rows).size


def _without(profile: Profile, starts: NDArray[np.int64], band: int, turns: Float) -> Float:
    return np.asarray(profile.without_each(turns, starts)[:, band])
