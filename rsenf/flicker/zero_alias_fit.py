"""Nonlinear least squares of flicker on texture, in all unknowns at once, and its errors.

Model: the logarithm of a picture's rows is a sum of texture, common gain, and the flicker as a
function of its phase, ``z[i,r] = b_r + γ_i + s_r·Σ_k Re c_k·exp(j·k·φ_ir)`` with
``φ_ir = ψ_i + 2π·q·u_r + (ψ'_i − mean ψ')·τ·(u_r − ½)``, in weighted Gaussian noise. The term with
``τ``: rows further down are exposed later, when the phase has moved on, so the ramp depends on the
frequency. That is a thousandth of the ramp, and still more than the noise of a clean recording.

Likelihood: Gaussian, and a wide prior of the phase's rate and of ``τ``. Texture and gain are linear
and many, so both are projected out of the data and of every derivative (variable projection), which
takes nothing from the flicker. The rest, each bin's phase, ``q``, ``τ`` and a few ``c_k``, is found
by damped Gauss-Newton steps (Levenberg-Marquardt).

Approximate: the residual is neither white nor random: a codec, a shaken camera or motion leave
errors that are correlated over rows and time, and the white-noise formula would give much too small
a standard error. Their effect on the flicker's own ramp is invisible, since the fit takes it for
flicker. It is measured on ramps nearby, without flicker.

References
----------
- Golub, G. H. and Pereyra, V. (1973), The differentiation of pseudo-inverses and nonlinear least
  squares problems whose variables separate, SIAM J. Numer. Anal. 10, 413.
- Marquardt, D. W. (1963), An algorithm for least-squares estimation of nonlinear parameters, J.
  SIAM 11, 431.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rsenf.flicker.zero_alias_rows import Complex, Float, RowLogs

# A grid's deviation wanders by some millihertz in a second. This prior is several times wider, in
# rad/s per square root of a second, so it only binds where noise would wander further.
RATE_WANDER = 0.05
# Prior standard deviation of τ (s): no read-out takes longer than about a frame.
READ_OUT_S = 0.05
ENOUGH = 0.01  # a step that decreases chi-squared by less is the last
STIFFEST = 1e6  # largest damping


@dataclass(frozen=True, eq=False)
class Flicker:
    """Parameters of the flicker: each bin's phase, ``q``, ``τ``, ``c_k`` and ``s``.

    ``c_1`` is real. ``s = 1 + Σ_p share_p·T_p(2u − 1)`` is the lamp's share in the light of each
    row, where daylight falls on some more than on others; ``share`` may be empty.
    """

    phase_rad: Float
    turns: float
    read_out_s: float
    series: Complex
    share: Float

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self.phase_rad.size + 1 + 2 * self.series.size + self.share.size

    def with_harmonics(self, harmonics: int) -> Flicker:
        """Return the same flicker with room for more harmonics."""
        series = np.zeros(harmonics, np.complex128)
        series[: self.series.size] = self.series
        return replace(self, series=series)

    def with_share(self, order: int) -> Flicker:
        """Return the same flicker with room for a share that varies down the rows."""
        return replace(self, share=np.zeros(order))

    def moved(self, step: Float) -> Flicker:
        """Return the flicker after a step, in the order of the normal equations."""
        bins = self.phase_rad.size
        pairs, shares = np.split(step[bins + 3 :], [2 * self.series.size - 2])
        change = np.concatenate(([step[bins + 2]], pairs[::2] + 1j * pairs[1::2]))
        return Flicker(
            self.phase_rad + step[:bins],
            self.turns + float(step[bins]),
            self.read_out_s + float(step[bins + 1]),
            self.series + change,
            self.share + shares,
        )

    def stretch(self, t_s: Float, place: Float) -> Float:
        """Derivative of the phase by ``τ``, shape (bins, rows)."""
        rate = np.gradient(self.phase_rad, t_s)
        return np.asarray((rate - rate.mean())[:, None] * (place - 0.5))

    def waves(self, t_s: Float, place: Float) -> Complex:
        """``exp(j·k·φ)``, shape (harmonics, bins, rows)."""
        first = np.exp(1j * self.phase_rad)[:, None] * np.exp(2j * np.pi * self.turns * place)
        if self.read_out_s:
            # A few milliradians: the expansion to second order suffices.
            small = 1j * self.read_out_s * self.stretch(t_s, place)
            first *= 1.0 + small + small * small / 2.0
        out = np.empty((self.series.size, *first.shape), np.complex128)
        out[0] = first
        for k in range(1, self.series.size):
            np.multiply(out[k - 1], first, out=out[k])
        return out

    def shares(self, place: Float) -> Float:
        """``s`` of each row, shape (rows,)."""
        return np.asarray(1.0 + self.share @ polynomials(place, self.share.size))

    def light(self, waves: Complex, place: Float) -> Float:
        """Flicker in the logarithms, shape (bins, rows)."""
        return np.asarray(np.tensordot(self.series, waves, 1).real * self.shares(place))


class Linearised:
    """A flicker, its residual on the data, and the derivatives there.

    Parameters
    ----------
    data : RowLogs
        The data.
    flicker : Flicker
        The model.
    noise_ratio : float
        Variance of the noise that acts on the phases over that of the residual.

    Attributes
    ----------
    residual : ndarray, shape (bins, rows)
    power : float
        Weighted sum of squares of the residual.
    noise_var : float
        Variance of one logarithm of weight 1, times ``noise_ratio``.
    """

    def __init__(self, data: RowLogs, flicker: Flicker, noise_ratio: float = 1.0) -> None:
        self.data, self.flicker = data, flicker
        self.waves = flicker.waves(data.t_s, data.place)
        self.residual = data.value - data.centred(flicker.light(self.waves, data.place))
        self.power = data.power(self.residual)
        spent = flicker.phase_rad.size + 2 * flicker.series.size + 1 + flicker.share.size
        self.noise_var = noise_ratio * self.power / data.freedom(spent)

    def cost(self, noise_var: float, prior: Float) -> float:
        """Weighted sum of squares, plus the prior's penalty."""
        known = self._known(len(prior))
        return self.power + noise_var * float(known @ prior @ known)

    def slope(self) -> Float:
        """Derivative of the light by the phase, shape (bins, rows)."""
        order = 1j * np.arange(1, self.flicker.series.size + 1)
        slope = np.tensordot(order * self.flicker.series, self.waves, 1).real
        return np.asarray(slope * self.flicker.shares(self.data.place))

    def columns(self) -> Float:
        """Centred derivatives by ``q``, ``τ``, ``c`` and shares: (parameters, bins, rows)."""
        flicker = self.flicker
        count = 1 + 2 * flicker.series.size + flicker.share.size
        out = np.empty((count, *self.residual.shape))
        for column, derivative in zip(out, self._derivatives(), strict=True):
            column[:] = derivative
        return self.data.centred(out)

    def _derivatives(self) -> Iterator[Float]:
        """Yield one after the other: all of them are megabytes."""
        data, flicker = self.data, self.flicker
        slope, shares = self.slope(), flicker.shares(data.place)
        yield slope * (2.0 * np.pi * data.place)
        yield slope * flicker.stretch(data.t_s, data.place)
        yield self.waves[0].real * shares
        for wave in self.waves[1:]:
            yield wave.real * shares
            yield -wave.imag * shares
        plain = np.tensordot(flicker.series, self.waves, 1).real
        for p in polynomials(data.place, flicker.share.size):
            yield plain * p

    def equations(self, prior: Float) -> tuple[Float, Float]:
        """Normal equations, texture and gain projected out (Golub and Pereyra 1973).

        A bin's phase affects that bin's rows alone, so without texture the phases' block is
        diagonal; projecting the texture out subtracts a product of rank ``rows``.
        """
        data, bins = self.data, self.flicker.phase_rad.size
        slope = data.without_gain(self.slope())
        pull = data.weighted(slope)
        others = self.columns()
        weighted = data.weighted(others).reshape(len(others), -1)
        normal = self.noise_var * prior
        gradient = -normal @ self._known(len(prior))
        normal[:bins, :bins] -= pull @ (slope * data.weight[:, None]).T / data.weight.sum()
        normal[np.arange(bins), np.arange(bins)] += np.einsum("im,im->i", pull, slope)
        cross = np.einsum("im,cim->ci", pull, others)
        normal[bins:, :bins] += cross
        normal[:bins, bins:] += cross.T
        normal[bins:, bins:] += weighted @ others.reshape(len(others), -1).T
        gradient[:bins] += np.einsum("im,im->i", pull, self.residual)
        gradient[bins:] += weighted @ self.residual.reshape(-1)
        return normal, gradient

    def covariance(self) -> Float:
        """Covariance of (phases, ``q``, ``τ``, ``c_1``, ``Re c_2``, ``Im c_2``, …, shares)."""
        normal, _ = self.equations(prior_precision(self.data.t_s, self.flicker.unknowns))
        return np.asarray(self.noise_var * np.linalg.pinv(normal, hermitian=True), np.float64)

    def _known(self, size: int) -> Float:
        """Unknowns that have a prior; 0 for the others."""
        known = np.zeros(size)
        known[: self.flicker.phase_rad.size] = self.flicker.phase_rad
        known[self.flicker.phase_rad.size + 1] = self.flicker.read_out_s
        return known


def refine(data: RowLogs, start: Flicker, steps: int, noise_ratio: float = 1.0) -> Linearised:
    """Descend from a start to the least squares near it (Levenberg-Marquardt) (Marquardt 1963).

    Parameters
    ----------
    data : RowLogs
        The data.
    start : Flicker
        Initial values, and the number of harmonics.
    steps : int
        Most steps.
    noise_ratio : float
        As for :class:`Linearised`.
    """
    prior = prior_precision(data.t_s, start.unknowns)
    now = Linearised(data, start, noise_ratio)
    normal, gradient = now.equations(prior)
    damping = 1e-3
    for _ in range(steps):
        stiff = normal + np.diag(damping * np.diag(normal))
        try:
            step = np.asarray(np.linalg.solve(stiff, gradient), np.float64)
        except np.linalg.LinAlgError:
            break  # singular: a picture that is the same for a minute
        tried = Linearised(data, now.flicker.moved(step), noise_ratio)
        gain = now.cost(now.noise_var, prior) - tried.cost(now.noise_var, prior)
        if gain <= 0.0:
            damping *= 10.0
            if damping > STIFFEST:
                break
            continue
        enough = gain < ENOUGH * now.noise_var
        now, damping = tried, max(damping / 10.0, 1e-9)
        if enough:
            break
        normal, gradient = now.equations(prior)
    return now


def polynomials(place: Float, count: int) -> Float:
    """Chebyshev polynomials of orders 1 to ``count`` down the frame, shape (count, rows)."""
    order = np.arange(1, count + 1)[:, None]
    return np.asarray(np.cos(order * np.arccos(2.0 * place - 1.0)))


def prior_precision(t_s: Float, unknowns: int) -> Float:
    """Prior precision of the unknowns: a random walk of the rate, and a read-out within a frame.

    The phases' level and slope, and all else, are free.
    """
    step = np.diff(t_s)
    change = np.zeros((t_s.size - 2, t_s.size))
    row = np.arange(t_s.size - 2)
    change[row, row] = 1.0 / step[:-1]
    change[row, row + 1] = -1.0 / step[:-1] - 1.0 / step[1:]
    change[row, row + 2] = 1.0 / step[1:]
    variance = RATE_WANDER**2 * (step[:-1] + step[1:]) / 2.0
    out = np.zeros((unknowns, unknowns))
    out[: t_s.size, : t_s.size] = change.T @ (change / variance[:, None])
    out[t_s.size + 1, t_s.size + 1] = READ_OUT_S**-2
    return out


NEAR_TURNS = np.array([-2.0, -1.75, -1.5, -1.25, -1.0, 1.0, 1.25, 1.5, 1.75, 2.0])
ASIDE_TURNS = np.array([0.75, 1.0, 1.25, 1.5, 2.0])
LEAST_TURNS = 0.5  # a slower ramp is hardly distinct from the gain
# A codec that delays changes affects the phase more than the visible residual: errors after x264 at
# 50 and 150 kbit/s are this many times what the residual alone would give.
HARM = 2.0
# Bins over which a codec's remains of one picture in the next are correlated.
SLOW_BINS = 8
# Blocks of residual that may be correlated, as their numbers over bins and over rows; one block of
# all bins, since a codec's effect on some rows may last as long as the clip.
BLOCKS = ((1, 12), (10, 12), (20, 12), (30, 24), (240, 12))


def explained(point: Linearised) -> float:
    """Share of the slow variation that the flicker explains; at most 1.

    The noise is taken as half of the mean squared difference between neighbouring bins.
    """
    data = point.data
    step = np.diff(point.residual, axis=0) ** 2 @ data.row_weight
    noise = 0.5 * step.mean() * data.weight.sum()
    total = data.power(data.value)
    return float((total - point.power) / max(total - min(noise, point.power), 1e-300))


def noise_ratio(point: Linearised) -> float:
    """Variance of the noise that acts on the phases, over that of white noise of the same power.

    The largest of three: of the residual along ramps nearby; along the flicker itself, where its
    modulus varies; and along ramps nearby that turn with the flicker, summed over several bins. 1
    unless they are larger than by chance.
    """
    data, residual = point.data, point.residual
    variance = point.power / data.freedom(0)
    turns = np.abs(point.flicker.turns + NEAR_TURNS)
    ramps = np.exp(-2j * np.pi * turns[turns > LEAST_TURNS, None] * data.place)
    seen = (residual * data.row_weight) @ ramps.T
    near = np.mean(np.abs(seen) ** 2 * data.weight[:, None]) / (variance * data.place.size)
    light = data.without_gain(point.flicker.light(point.waves, data.place))
    along = (light * residual) @ data.row_weight
    modulus = np.mean(along**2 * data.weight / (light**2 @ data.row_weight)) / variance
    chance = 2.0 * np.sqrt(2.0 / data.t_s.size)
    fast = 1.0 + HARM**2 * max(max(near, modulus) - 1.0 - chance, 0.0)
    turning = seen * (np.exp(-1j * point.flicker.phase_rad) * data.weight)[:, None]
    blocks = np.arange(0, data.t_s.size, SLOW_BINS)
    sums, weights = (np.add.reduceat(x, blocks) for x in (turning, data.weight))
    slow = np.mean(np.abs(sums) ** 2 / weights[:, None]) / (variance * data.place.size)
    slow_chance = chance * np.sqrt(SLOW_BINS)
    return float(max(fast, slow if slow > 1.0 + slow_chance else 1.0))


def standard_error(point: Linearised, covariance: Float, parameter: int, ratio: float) -> float:
    """Standard error of a parameter other than the phases.

    From the covariance, unless two others together are larger: how the parts of the residual that
    act on the parameter add up over blocks, and how they would act if the flicker's ramp were
    another.

    Parameters
    ----------
    point : Linearised
        Where the fit ended.
    covariance : ndarray
        Its covariance.
    parameter : int
        Place after the phases: 0 is ``q``, 1 is ``τ``, 2 is ``c_1``.
    ratio : float
        Of :func:`noise_ratio`, as included in the covariance.
    """
    bins = point.flicker.phase_rad.size
    white = float(np.sqrt(covariance[bins + parameter, bins + parameter]))
    inverse = covariance[bins + parameter] / point.noise_var
    acting = point.data.without_gain(point.slope()) * inverse[:bins, None]
    acting = acting + np.tensordot(inverse[bins:], point.columns(), 1)
    acting = point.data.weighted(point.data.without_texture(acting)) * point.residual
    blocks = max(_by_blocks(acting, *block) for block in BLOCKS)
    aside = _by_other_ramps(acting, point.data.place)
    beyond_white = max(HARM * (aside - white / np.sqrt(ratio)), 0.0)
    return float(max(white, np.hypot(blocks, beyond_white)))


def _by_blocks(acting: Float, over_bins: int, over_rows: int) -> float:
    bins, rows = acting.shape[:2]
    in_time = np.add.reduceat(acting, np.arange(0, bins, max(bins // over_bins, 1)), axis=0)
    blocks = np.add.reduceat(in_time, np.arange(0, rows, max(rows // over_rows, 1)), axis=1)
    return float(np.sqrt(np.sum(blocks**2)))


def _by_other_ramps(acting: Float, place: Float) -> float:
    angle = 2.0 * np.pi * ASIDE_TURNS[:, None] * place
    aside = np.sqrt(2.0) * np.concatenate([np.cos(angle), np.sin(angle)])
    return float(np.sqrt(np.mean((aside @ acting.sum(axis=0)) ** 2)))
