"""Joint Gauss-Newton fit of the flicker's phase, amplitudes and ramp, with none assumed known.

Model: the light of one lamp has the same waveform on all rows, so that its order ``k`` runs down
the rows as ``s(u)·exp(j·2π·k·q·u)``: ``q`` turns of the first harmonic a frame, and the scene's
texture ``s``. The columns' amplitudes are

    C_ik = a_k·T_ik(q) + D_ik

with ``T`` the columns of that ramp, ``a`` and ``q`` free, and ``D`` a small random deviation: other
lamps, daylight on some rows only, texture finer than the columns hold. Its variance is learned from
the data. While the phase turns little, this structure alone separates orders with mirrored aliases
(200 Hz and 100 Hz at 30 frames/s).

Likelihood: Gaussian with Student-t weights per node. Nuisance unknowns are eliminated from the
normal equations (Schur complement), so that the information about the path is marginal over them.
How much rougher than usual the path is, is learned too.

Approximate: linear about the last step, and the weights are taken as known.

References
----------
- MacKay, D. J. C. (1992), Bayesian interpolation, Neural Computation 4, 415.
- Lange, K. L., Little, R. J. A. and Taylor, J. M. G. (1989), Robust statistical modeling using the
  t distribution, J. American Statistical Association 84, 881.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.grid_prior import FREE, PhasePrior
from rsenf.flicker.lines import ProfileBasis, alias_hz
from rsenf.flicker.phase_likelihood import (
    ACROSS_HZ,
    ALONG_HZ,
    COLUMNS_HZ,
    SLOW_HZ,
    TAILS,
    Gathered,
    SufficientStatistics,
    gain_around,
    noise_of,
    noise_of_turning,
    power_of,
)

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Most iterations; a smaller step (rad) is the last.
STEPS, REST_RAD = 4, 1e-3
# Amplitudes' relative deviation from the ramp's: initial, least and largest; and the least of any
# order relative to the loudest.
SPREAD, LEAST_SPREAD, MOST_SPREAD, FAINTEST = 0.02, 0.002, 0.5, 2e-4
# Prior standard deviation of the turns down the rows.
TURNS_STD = 0.3
# Orders with aliases nearer than this share a noise estimate.
APART_HZ = 1.5
# Least noise of the columns' sum, relative to that expected from single columns.
LEAST_EXCESS = 1e-3
FARTHEST_RAD = 0.5  # in one step
# Beginnings of the groups of directions whose roughness is learned together; and number of
# directions that the usual roughness counts for.
BANDS, PRIOR_COUNT = (4, 8, 18, 38), 4.0


@dataclass(eq=False)
class State:
    """State of the fit.

    Attributes
    ----------
    coefficient : ndarray, shape (directions,)
        Path in the prior's directions.
    found : ndarray, shape (waves, columns)
        Coefficients of the waves in the columns; the first wave is the constant.
    trust, gain : ndarray, shape (nodes,)
        Robust weight of each node, and relative amplitude of the flicker around it.
    turns : float
        Turns of the first harmonic down the rows.
    """

    coefficient: Float
    found: Float
    trust: Float
    gain: Float
    turns: float

    @property
    def amplitude(self) -> Complex:
        """Complex amplitudes ``C_k``, shape (orders, columns)."""
        return np.asarray(self.found[1::2] - 1j * self.found[2::2])


@dataclass(frozen=True, eq=False)
class Joint:
    """Result of the fit.

    Attributes
    ----------
    state : State
    noise : ndarray, shape (orders, columns)
        Noise variance of a frame in each column near each order.
    information : ndarray, shape (nodes,)
        Fisher information about the phase at each node, with all else known.
    covariance : ndarray, shape (directions, directions)
        Of the path's coefficients, marginal over all else.
    """

    state: State
    noise: Float
    information: Float
    covariance: Float


class JointFit:
    """Finds the posterior mode of path, amplitudes and ramp.

    Parameters
    ----------
    frames : Gathered
    prior : PhasePrior
    basis : ProfileBasis
    orders : tuple of float
        Multiples of the first harmonic's frequency, halves included.
    """

    def __init__(
        self, frames: Gathered, prior: PhasePrior, basis: ProfileBasis, orders: tuple[float, ...]
    ) -> None:
        self._frames, self._prior, self._basis = frames, prior, basis
        self._orders, self._order = orders, np.asarray(orders, np.float64)
        band = _bands(np.append(0.0, self._order * frames.carrier_hz), frames.rate_hz)
        of_wave = np.append(band[0], np.repeat(band[1:], 2))
        self._together = (of_wave[:, None] == of_wave).astype(np.float64)
        # Matrix that averages over orders with near aliases.
        near = (band[1:, None] == band[1:]).astype(np.float64)
        self._near = near / near.sum(axis=1, keepdims=True)
        with_zero = np.flatnonzero(band[1:] == band[0])
        self._like_constant = int(with_zero[0]) if with_zero.size else 0
        self._spread, self._rough = SPREAD, np.ones(prior.basis.shape[1])

    def run(self, state: State) -> Joint:
        """Iterate from a start to the posterior mode (MacKay 1992)."""
        turns, directions = state.turns, state.coefficient.size
        lamp: Complex | None = None
        for taken in range(1, STEPS + 1):
            phase = self._frames.phase_rad(self._prior.basis @ state.coefficient)
            stats = self._frames.sums(self._frames.waves(phase, self._orders)).weighted(state.trust)
            resid = stats.residuals(state.found)
            noise = self._measure(state, stats, resid)
            ramp = self._ramp(state, lamp)
            step = self._equations(state, stats, resid, noise, ramp)
            step.normal[-1, -1] += TURNS_STD**-2
            step.pull[-1] += (turns - state.turns) / TURNS_STD**2
            covariance: Float = np.asarray(np.linalg.inv(step.normal), np.float64)
            move = covariance @ step.pull
            way = self._prior.basis[:, 1:] @ move[1:directions]
            far = float(np.abs(way).max())
            share = min(1.0, FARTHEST_RAD / max(far, 1e-12))
            move *= share
            change = (share * step.amplitude_step - step.theirs @ move).T
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
            self._learn_spread(ramp, apart, step.amplitude_var)
            self._learn_roughness(state.coefficient, covariance.diagonal()[:directions])
        return Joint(state, noise.variance, step.information, covariance[:directions, :directions])

    def _measure(self, state: State, stats: SufficientStatistics, resid: Float) -> _Noise:
        """Noise near each order, per column and of their weighted sum, and the weights from it."""
        real, imag = resid[:, 1::2], resid[:, 2::2]
        count = float(stats.waves[:, 0, 0].sum())
        variance = self._near @ (noise_of_turning(real, imag, COLUMNS_HZ) / count)
        variance = np.maximum(variance, 1e-6 * variance.max(axis=1, keepdims=True) + 1e-12)
        amplitude = state.amplitude
        weighted = self._order[:, None] * amplitude / variance
        sums = np.einsum("nkc,kc->nk", real, weighted.real)
        sums -= np.einsum("nkc,kc->nk", imag, weighted.imag)
        turned = np.einsum("nkc,kc->nk", real, weighted.imag)
        turned += np.einsum("nkc,kc->nk", imag, weighted.real)
        along, across = -turned, sums
        power = np.sum(np.abs(amplitude) ** 2 / variance, axis=1)
        expected = 0.5 * self._order**2 * power * stats.waves[:, :1, 0]
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
        """Expected amplitudes, and their derivatives, for one lamp that lights all rows alike."""
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
        self, state: State, stats: SufficientStatistics, resid: Float, noise: _Noise, ramp: _Ramp
    ) -> _Equations:
        """Normal equations of path, lamp and turns; the amplitudes' deviations are eliminated."""
        nodes, waves, columns = resid.shape
        basis, root = self._prior.basis, noise.root
        sums = stats.waves * self._together
        turned = np.zeros_like(state.found)
        turned[1::2] = self._order[:, None] * state.found[2::2]
        turned[2::2] = -self._order[:, None] * state.found[1::2]
        turned *= root
        information = noise.gain**2 * (sums.reshape(nodes, -1) @ (turned @ turned.T).ravel())
        pull = noise.gain * (resid.reshape(nodes, -1) @ (turned * root).ravel())
        shared = (sums.reshape(-1, waves) @ turned).reshape(resid.shape)
        shared *= root * noise.gain[:, None, None]
        by_path = (basis.T @ shared.reshape(nodes, -1)).reshape(-1, waves, columns)
        held = ramp.precision.T[:, :, None] * ramp.slope
        cross = np.concatenate([by_path.transpose(2, 1, 0), -held], axis=2)
        gram = root.T[:, :, None] * root.T[:, None, :] * sums.sum(axis=0)
        every = np.arange(waves)
        gram[:, every, every] += ramp.precision.T
        apart = (ramp.precision * (state.found - ramp.mean)).T
        amplitude_pull = (root**2 * resid.sum(axis=0)).T - apart
        inverse = np.linalg.inv(gram)
        theirs, alone = inverse @ cross, (inverse @ amplitude_pull[:, :, None])[:, :, 0]
        paths = basis.shape[1]
        normal = -cross.reshape(-1, cross.shape[2]).T @ theirs.reshape(-1, cross.shape[2])
        along = basis.T @ (information[:, None] * basis)
        normal[:paths, :paths] += along
        normal[0, 0] += along[0, 0]  # the zero of phase is degenerate with the amplitudes
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

    def _learn_spread(self, ramp: _Ramp, apart: Float, amplitude_var: Float) -> None:
        """Update the amplitudes' deviation from the ramp, from the loudest order."""
        size2 = np.abs(ramp.lamp) ** 2
        loud = int(np.argmax(size2))
        off = (apart**2 + amplitude_var)[1 + 2 * loud : 3 + 2 * loud].sum()
        scale = 2.0 * size2[loud] * ramp.even[loud].sum()
        spread = float(np.sqrt(off / max(scale, 1e-30)))
        self._spread = min(max(spread, LEAST_SPREAD), MOST_SPREAD)

    def _learn_roughness(self, coefficient: Float, variance: Float) -> None:
        """Update how much rougher than usual the path is; finer directions no less than coarser."""
        known = 1.0 - variance / self._rough**2
        least = 1.0
        for first, end in zip(BANDS, (*BANDS[1:], coefficient.size), strict=True):
            of = slice(FREE + first, FREE + end)
            moved = float(np.sum(coefficient[of] ** 2)) + PRIOR_COUNT
            least = max(least, moved / (float(np.sum(known[of])) + PRIOR_COUNT))
            self._rough[of] = np.sqrt(least)


@dataclass(frozen=True, eq=False)
class _Noise:
    variance: Float  # (orders, columns)
    root: Float  # square root of the weights, (waves, columns)
    trust: Float
    gain: Float


@dataclass(frozen=True, eq=False)
class _Ramp:
    lamp: Complex  # (orders,)
    mean: Float  # (waves, columns)
    slope: Float  # derivatives by the lamp's parts and the turns, (columns, waves, unknowns)
    precision: Float  # (waves, columns)
    even: Float  # (orders, columns)


@dataclass(frozen=True, eq=False)
class _Equations:
    normal: Float
    pull: Float
    information: Float  # (nodes,)
    theirs: Float  # response of the amplitudes to the other unknowns, (columns, waves, unknowns)
    amplitude_step: Float  # step of the amplitudes with the others fixed, (columns, waves)
    amplitude_var: Float  # (waves, columns)


def _disagreement(along: Float, hears: Float) -> float:
    """Excess of the columns' disagreement about the slow phase over the fast phase; at least 1.

    ``along`` is the residual of each column along the phase, shape (nodes, columns), and ``hears``
    their information. A codec or a second lamp disturbs a column for seconds, which the noise
    beside the tone doesn't show.
    """
    share = hears / max(float(hears.sum()), 1e-30)
    apart = along - along.sum(axis=1, keepdims=True) * share
    by_column = 1.0 / np.maximum(hears, 1e-3 * hears.max() + 1e-30)
    slow, fast = (float(power_of(apart, band) @ by_column) for band in (SLOW_HZ, ALONG_HZ))
    return max(slow / max(fast, 1e-30), 1.0)


def _bands(freq_hz: Float, rate_hz: float) -> NDArray[np.intp]:
    """Number of the band that each frequency's alias (absolute value) belongs to."""
    alias = np.abs([alias_hz(f, rate_hz) for f in freq_hz.tolist()])
    order = np.argsort(alias)
    band = np.empty(alias.size, np.intp)
    band[order] = np.cumsum(np.diff(alias[order], prepend=alias[order[0]]) > APART_HZ)
    return band
