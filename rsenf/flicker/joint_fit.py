"""Phase, amplitudes and ramp of the flicker in one step, none of them taken for known.

A lamp's light is one wave at all rows, so that order ``k`` of it runs down the rows as
``s(u)·exp(j·2π·k·q·u)``: with ``q`` turns of the first harmonic a frame, and the scene's texture
``s``. The columns' amplitudes are

    C_ik = a_k·T_ik(q) + D_ik

with ``T`` the columns of that ramp, ``a`` and ``q`` free, and ``D`` small: other lamps, daylight
that falls on some rows only, detail of the texture that the columns don't hold. How small is
learned from the data. Orders whose aliases are mirror images of each other (200 Hz beside 100 Hz at
30 frames/s) are told apart by that alone while the phase turns too little.

Gauss-Newton steps in all unknowns at once; those that aren't wanted are eliminated (Schur's
complement), so that the information that is left of the path's is marginal over all of them. How
rough the path is, beyond what grids usually are, is learned as well (D. MacKay, "Bayesian
interpolation", Neural Computation 4, 1992).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import PhasePrior
from rsenf.flicker.lines import alias_hz
from rsenf.flicker.node_noise import (
    ACROSS_HZ,
    ALONG_HZ,
    COLUMNS_HZ,
    SLOW_HZ,
    gain_around,
    noise_of,
    noise_of_turning,
    power_of,
)
from rsenf.flicker.node_sums import Gathered, SufficientStatistics
from rsenf.flicker.profile import ProfileBasis

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Steps taken at most, and the least that is worth another.
STEPS, REST_RAD = 4, 1e-3
# Amplitudes' relative deviation from the ramp's: at first, at least and at most; and that of any
# order relative to the loudest.
SPREAD, LEAST_SPREAD, MOST_SPREAD, FAINTEST = 0.02, 0.002, 0.5, 2e-4
# Of the turns down the rows, as known before (a standard deviation).
TURNS_STD = 0.3
# Aliases this near each other share their noise.
APART_HZ = 1.5
# Noise is never less than this share of what would be expected from the columns one by one.
LEAST_EXCESS = 1e-3
FARTHEST_RAD = 0.5  # in one step
# Directions of the path whose roughness is learned together, and how many of them what is usual
# counts for.
FREE, BANDS, USUAL = 2, (4, 8, 18, 38), 4.0
TAILS = 4.0


@dataclass(eq=False)
class State:
    """Where a fit is.

    Attributes
    ----------
    coefficient : ndarray, shape (directions,)
        Of the path, by the prior's directions.
    found : ndarray, shape (waves, columns)
        Each wave's share of the columns; the first wave is the constant.
    trust, gain : ndarray, shape (nodes,)
    turns : float
        Of the first harmonic down the rows.
    """

    coefficient: Float
    found: Float
    trust: Float
    gain: Float
    turns: float

    @property
    def amplitude(self) -> Complex:
        """``C_k``, shape (orders, columns)."""
        return np.asarray(self.found[1::2] - 1j * self.found[2::2])


@dataclass(frozen=True, eq=False)
class Joint:
    """What a fit came to.

    Attributes
    ----------
    state : State
    noise : ndarray, shape (orders, columns)
        Variance of a frame in each column near each order.
    information : ndarray, shape (nodes,)
        Of the phase at each node, were all else known.
    covariance : ndarray, shape (directions, directions)
        Of the path's coefficients.
    """

    state: State
    noise: Float
    information: Float
    covariance: Float


class JointFit:
    """Steps towards the most probable path, amplitudes and ramp.

    Parameters
    ----------
    frames : Gathered
    prior : PhasePrior
    basis : ProfileBasis
    orders : tuple of float
        Multiples of the first harmonic's phase; halves among them.
    """

    def __init__(
        self, frames: Gathered, prior: PhasePrior, basis: ProfileBasis, orders: tuple[float, ...]
    ) -> None:
        self._frames, self._prior, self._basis = frames, prior, basis
        self._orders, self._order = orders, np.asarray(orders, np.float64)
        band = _bands(np.append(0.0, self._order * frames.carrier_hz), frames.rate_hz)
        of_wave = np.append(band[0], np.repeat(band[1:], 2))
        self._together = (of_wave[:, None] == of_wave).astype(np.float64)
        # Share of each order in the mean over those whose aliases are near.
        near = (band[1:, None] == band[1:]).astype(np.float64)
        self._near = near / near.sum(axis=1, keepdims=True)
        with_zero = np.flatnonzero(band[1:] == band[0])
        self._like_constant = int(with_zero[0]) if with_zero.size else 0
        self._spread, self._rough = SPREAD, np.ones(prior.basis.shape[1])

    def run(self, state: State) -> Joint:
        """Go from a start to the end."""
        turns, directions = state.turns, state.coefficient.size
        lamp: Complex | None = None
        for taken in range(1, STEPS + 1):
            phase = self._frames.phase_rad(self._prior.basis @ state.coefficient)
            told = self._frames.told(self._frames.waves(phase, self._orders)).weighted(state.trust)
            left = told.left(state.found)
            noise = self._measure(state, told, left)
            ramp = self._ramp(state, lamp)
            step = self._equations(state, told, left, noise, ramp)
            step.normal[-1, -1] += TURNS_STD**-2
            step.pull[-1] += (turns - state.turns) / TURNS_STD**2
            covariance: Float = np.asarray(np.linalg.inv(step.normal), np.float64)
            move = covariance @ step.pull
            way = self._prior.basis[:, 1:] @ move[1:directions]
            far = float(np.abs(way).max())
            share = min(1.0, FARTHEST_RAD / max(far, 1e-12))
            move *= share
            change = (share * step.own - step.theirs @ move).T
            state = State(
                state.coefficient + move[:directions],
                state.found + change,
                noise.trust,
                noise.gain,
                state.turns + float(move[-1]),
            )
            lamp = ramp.lamp + move[directions:-1:2] + 1j * move[directions + 1 : -1 : 2]
            apart = state.found - ramp.mean - (ramp.slope @ move[directions:]).T
            if taken > 1 and far < REST_RAD:
                break
            self._learn_spread(ramp, apart, step.own_var)
            self._learn_roughness(state.coefficient, covariance.diagonal()[:directions])
        return Joint(state, noise.variance, step.information, covariance[:directions, :directions])

    def _measure(self, state: State, told: SufficientStatistics, left: Float) -> _Noise:
        """Noise near each order, by column and of their sum; and what follows from it."""
        real, imag = left[:, 1::2], left[:, 2::2]
        seen = float(told.waves[:, 0, 0].sum())
        variance = self._near @ (noise_of_turning(real, imag, COLUMNS_HZ) / seen)
        variance = np.maximum(variance, 1e-6 * variance.max(axis=1, keepdims=True) + 1e-12)
        amplitude = state.amplitude
        weighted = self._order[:, None] * amplitude / variance
        sums = np.einsum("nkc,kc->nk", real, weighted.real)
        sums -= np.einsum("nkc,kc->nk", imag, weighted.imag)
        turned = np.einsum("nkc,kc->nk", real, weighted.imag)
        turned += np.einsum("nkc,kc->nk", imag, weighted.real)
        along, across = -turned, sums
        power = np.sum(np.abs(amplitude) ** 2 / variance, axis=1)
        expected = 0.5 * self._order**2 * power * told.waves[:, :1, 0]
        total = np.maximum(self._near @ expected.sum(axis=0), 1e-30)
        summed = np.maximum(noise_of(along, ALONG_HZ), noise_of(across, ACROSS_HZ))
        excess = np.maximum(self._near @ summed / total, LEAST_EXCESS)
        loud = int(np.argmax(power))
        excess *= _disagreement(
            -(real[:, loud] * weighted[loud].imag + imag[:, loud] * weighted[loud].real),
            np.abs(amplitude[loud]) ** 2 / variance[loud],
        )
        weight = 1.0 / (variance * excess[:, None])
        away = (along[:, loud] ** 2 + across[:, loud] ** 2) / np.maximum(
            state.trust * expected[:, loud] * excess[loud], 1e-30
        )
        return _Noise(
            variance,
            np.sqrt(np.vstack([weight[self._like_constant], np.repeat(weight, 2, axis=0)])),
            (TAILS + 2.0) / (TAILS + away),
            gain_around(across[:, loud], expected[:, loud]),
        )

    def _ramp(self, state: State, lamp: Complex | None) -> _Ramp:
        """What amplitudes a lamp would have that shines on all rows alike."""
        of_ramp, by_turns = self._basis.lit(state.found[0], state.turns * self._order)
        power = np.abs(of_ramp) ** 2
        if lamp is None:
            lamp = np.sum(of_ramp.conj() * state.amplitude, axis=1) / power.sum(axis=1)
        even = 0.5 * (power + power.mean(axis=1, keepdims=True))
        size2 = np.abs(lamp[:, None]) ** 2
        spread2 = even * (self._spread**2 * size2 + FAINTEST**2 * size2.max() + 1e-30)
        orders, columns = of_ramp.shape
        slope = np.zeros((columns, 1 + 2 * orders, 2 * orders + 1))
        mean = np.zeros((1 + 2 * orders, columns))
        at, turned = lamp[:, None] * of_ramp, (lamp * self._order)[:, None] * by_turns
        for k in range(orders):
            cosine, sine = 1 + 2 * k, 2 + 2 * k
            mean[cosine], mean[sine] = at[k].real, -at[k].imag
            slope[:, cosine, 2 * k], slope[:, sine, 2 * k] = of_ramp[k].real, -of_ramp[k].imag
            slope[:, cosine, 2 * k + 1] = -of_ramp[k].imag
            slope[:, sine, 2 * k + 1] = -of_ramp[k].real
            slope[:, cosine, -1], slope[:, sine, -1] = turned[k].real, -turned[k].imag
        precision = np.vstack([np.zeros(columns), np.repeat(1.0 / spread2, 2, axis=0)])
        return _Ramp(lamp, mean, slope, precision, even)

    def _equations(
        self, state: State, told: SufficientStatistics, left: Float, noise: _Noise, ramp: _Ramp
    ) -> _Equations:
        """Normal equations of path, lamp and turns, the amplitudes' own deviations eliminated."""
        nodes, waves, columns = left.shape
        basis, root = self._prior.basis, noise.root
        sums = told.waves * self._together
        turned = np.zeros_like(state.found)
        turned[1::2] = self._order[:, None] * state.found[2::2]
        turned[2::2] = -self._order[:, None] * state.found[1::2]
        turned *= root
        information = noise.gain**2 * (sums.reshape(nodes, -1) @ (turned @ turned.T).ravel())
        pull = noise.gain * (left.reshape(nodes, -1) @ (turned * root).ravel())
        shared = (sums.reshape(-1, waves) @ turned).reshape(left.shape)
        shared *= root * noise.gain[:, None, None]
        by_path = (basis.T @ shared.reshape(nodes, -1)).reshape(-1, waves, columns)
        held = ramp.precision.T[:, :, None] * ramp.slope
        cross = np.concatenate([by_path.transpose(2, 1, 0), -held], axis=2)
        own = root.T[:, :, None] * root.T[:, None, :] * sums.sum(axis=0)
        every = np.arange(waves)
        own[:, every, every] += ramp.precision.T
        apart = (ramp.precision * (state.found - ramp.mean)).T
        own_pull = (root**2 * left.sum(axis=0)).T - apart
        inverse = np.linalg.inv(own)
        theirs, alone = inverse @ cross, (inverse @ own_pull[:, :, None])[:, :, 0]
        paths = basis.shape[1]
        normal = -cross.reshape(-1, cross.shape[2]).T @ theirs.reshape(-1, cross.shape[2])
        along = basis.T @ (information[:, None] * basis)
        normal[:paths, :paths] += along
        normal[0, 0] += along[0, 0]  # which phase is 0 is for the amplitudes to say
        normal[range(paths), range(paths)] += 1.0 / self._rough**2
        normal[paths:, paths:] += np.einsum("cwb,cwd->bd", ramp.slope, held)
        normal.flat[:: len(normal) + 1] *= 1.0 + 1e-10
        outer = np.concatenate(
            [
                basis.T @ pull - state.coefficient / self._rough**2,
                np.einsum("cwb,cw->b", ramp.slope, apart),
            ]
        )
        outer -= np.einsum("cwb,cw->b", cross, alone)
        return _Equations(normal, outer, information, theirs, alone, inverse[:, every, every].T)

    def _learn_spread(self, ramp: _Ramp, apart: Float, own_var: Float) -> None:
        """How far amplitudes are from the ramp's, by the loudest order."""
        size2 = np.abs(ramp.lamp) ** 2
        loud = int(np.argmax(size2))
        off = (apart**2 + own_var)[1 + 2 * loud : 3 + 2 * loud].sum()
        scale = 2.0 * size2[loud] * ramp.even[loud].sum()
        spread = float(np.sqrt(off / max(scale, 1e-30)))
        self._spread = min(max(spread, LEAST_SPREAD), MOST_SPREAD)

    def _learn_roughness(self, coefficient: Float, variance: Float) -> None:
        """How much rougher than usual the path is; beyond what the data show, as rough as there."""
        known = 1.0 - variance / self._rough**2
        least = 1.0
        for first, end in zip(BANDS, (*BANDS[1:], coefficient.size), strict=True):
            of = slice(FREE + first, FREE + end)
            moved = float(np.sum(coefficient[of] ** 2)) + USUAL
            least = max(least, moved / (float(np.sum(known[of])) + USUAL))
            self._rough[of] = np.sqrt(least)


@dataclass(frozen=True, eq=False)
class _Noise:
    variance: Float  # (orders, columns)
    root: Float  # of the weights, (waves, columns)
    trust: Float
    gain: Float


@dataclass(frozen=True, eq=False)
class _Ramp:
    lamp: Complex  # (orders,)
    mean: Float  # (waves, columns)
    slope: Float  # by the lamp's parts and the turns, (columns, waves, unknowns)
    precision: Float  # (waves, columns)
    even: Float  # (orders, columns)


@dataclass(frozen=True, eq=False)
class _Equations:
    normal: Float
    pull: Float
    information: Float  # (nodes,)
    theirs: Float  # how amplitudes answer to the other unknowns, (columns, waves, unknowns)
    own: Float  # where they go by themselves, (columns, waves)
    own_var: Float  # (waves, columns)


def _disagreement(along: Float, hears: Float) -> float:
    """How much more columns disagree about the slow phase than about what is faster; at least 1.

    ``along`` is what is left of each column along the phase, shape (nodes, columns), and
    ``hears`` their information. What a codec or a second lamp does to a column hangs together over
    seconds, and noise beside the tone shows nothing of it.
    """
    share = hears / max(float(hears.sum()), 1e-30)
    apart = along - along.sum(axis=1, keepdims=True) * share
    by_column = 1.0 / np.maximum(hears, 1e-3 * hears.max() + 1e-30)
    slow, fast = (float(power_of(apart, band) @ by_column) for band in (SLOW_HZ, ALONG_HZ))
    return max(slow / max(fast, 1e-30), 1.0)


def _bands(freq_hz: Float, rate_hz: float) -> NDArray[np.intp]:
    """Number of the band that each frequency's alias, on either side of 0 Hz, lies in."""
    alias = np.abs([alias_hz(f, rate_hz) for f in freq_hz.tolist()])
    order = np.argsort(alias)
    band = np.empty(alias.size, np.intp)
    band[order] = np.cumsum(np.diff(alias[order], prepend=alias[order[0]]) > APART_HZ)
    return band
