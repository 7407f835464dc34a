"""Scores lags by a clip's phases: log-likelihood at a lag less that under any grid.

Model: that of :mod:`rsenf.match.phase_filter` at a lag, and of :mod:`rsenf.match.ou_likelihood`
under any grid; a share of the blocks is bad, and tells nothing.

Likelihood: both of the same phases, those whose step lies in the reference. So lags with gaps, and
lags in different references, are comparable, and a score of zero means that the reference explains
the clip no better than an arbitrary grid does. It is a mixture over sizes of the errors, of the
clock error, and of the share of bad blocks.

Approximate: with bad blocks the clock offset is not integrated out but found by iteratively
reweighted least squares, with a Laplace factor.

References
----------
- Holland, P. W. and Welsch, R. E. (1977), Robust regression using iteratively reweighted
  least-squares, Communications in Statistics A6, 813.
- Tierney, L. and Kadane, J. B. (1986), Accurate approximations for posterior moments and marginal
  densities, J. American Statistical Association 81, 82.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsenf.match.clip_phase import ClipPhase, averaged
from rsenf.match.forecast import forecast
from rsenf.match.ou_likelihood import BAD_SHARE, generic_log_likelihood, no_grid_log_likelihood
from rsenf.match.phase_filter import (
    ERRORS,
    ERRORS_OF_SUMS,
    ClipErrors,
    Errors,
    Innovations,
    blocks_of,
    innovations,
)
from rsenf.match.series import Grid
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray

# Prior of the clock error, a mixture of Gaussians: (weight, size in units of ``clock_scale_ppm``).
# Most cameras are within 30 ppm, a real one is at 70.
CLOCKS = ((0.5, 0.5), (0.35, 1.2), (0.15, 3.0))
PLAIN_SHARE = 0.85  # of references that are not averaged over a window
WORTHWHILE = 4.0  # least number of known steps for a lag to be scored
QUICK: tuple[Errors, ...] = tuple(
    Errors(0.25, hz, ClipErrors(1.0, ratio)) for hz in (3e-4, 1.5e-3) for ratio in (1.0, 2.5)
)
QUICK_OF_SUMS: tuple[Errors, ...] = tuple(
    Errors(0.25, hz, ClipErrors(1.0, ratio, drift_s=12.0))
    for ratio, hz in ((1.0, 3e-4), (2.5, 3e-4), (2.0, 1.5e-3), (7.0, 3e-4))
)
# Prior of the share of bad blocks: (weight, share). A bad block follows no time of the reference.
BAD_SHARES = ((0.7, 0.0), (0.18, 0.05), (0.09, 0.2), (0.03, 0.5))
MOST_ODDS = 700.0  # nats of a block: a larger exponent would overflow
CLOCK_PASSES = 2  # iterations of the clock offset from the good blocks


@dataclass(frozen=True)
class Clock:
    """Offset of the clip's ENF from the reference's, with its standard error."""

    offset_hz: float
    offset_std_hz: float


@dataclass(frozen=True, eq=False)
class Reading:
    """A clip's phases for one assumption on the reference, with their likelihoods without it.

    ``share`` is the prior weight of the assumption. Log-likelihoods of each phase given those
    before it, shape (n,): ``generic`` under any grid, ``robust`` the same with bad blocks allowed
    for, and ``no_grid`` under none.
    """

    share: float
    clip: ClipPhase
    generic: FloatArray
    robust: FloatArray
    no_grid: FloatArray


@functools.lru_cache(maxsize=4)
def readings_of(clip: ClipPhase) -> tuple[Reading, ...]:
    """Return a clip's readings: the reference is the grid's frequency, or an average of it."""
    coarse = averaged(clip)
    if coarse is None:
        return (_reading(1.0, clip),)
    return _reading(PLAIN_SHARE, clip), _reading(1.0 - PLAIN_SHARE, coarse)


def _reading(share: float, clip: ClipPhase) -> Reading:
    generic, robust = (generic_log_likelihood(clip, robust=robust) for robust in (False, True))
    return Reading(share, clip, generic, robust, no_grid_log_likelihood(clip))


class PhaseScorer:
    """Scores lags of one reference for one clip.

    Parameters
    ----------
    clip : ClipPhase
    grid : Grid
    settings : MatchSettings
    robust : bool
        Whether blocks of the clip may be bad. False for a part of an edited clip, which must fit as
        a whole.

    Notes
    -----
    The reference is the grid's frequency, or an average of it over a window; under the second
    assumption changes too fast for the average don't count for or against a lag.
    """

    def __init__(
        self, clip: ClipPhase, grid: Grid, settings: MatchSettings, *, robust: bool = True
    ) -> None:
        self.grid, self.settings, self._robust = grid, settings, robust
        self.readings = readings_of(clip)
        errors, quick = (ERRORS_OF_SUMS, QUICK_OF_SUMS) if clip.is_summed else (ERRORS, QUICK)
        self._errors = rougher(errors, settings.reference_noise_hz)
        self._quick = rougher(quick, settings.reference_noise_hz)

    @property
    def clip(self) -> ClipPhase:
        """The clip's phases, not averaged."""
        return self.readings[0].clip

    def scores(
        self, lag_s: FloatArray, among: NDArray[np.bool_] | None = None, *, quick: bool = False
    ) -> FloatArray:
        """Log-likelihood ratios of lags against any grid; minus infinity with too few phases.

        Parameters
        ----------
        lag_s : ndarray, shape (c,)
        among : ndarray of bool, shape (n, c), optional
            Phases, not averaged, that count, together with the step to each of them.
        quick : bool
            Use only a few sizes of the errors.

        Returns
        -------
        ndarray, shape (c,)
            Nats.
        """
        errors = self._quick if quick else self._errors
        if among is not None:
            return self._read(self.readings[0], lag_s, errors, among)
        found = [
            math.log(reading.share) + self._read(reading, lag_s, errors)
            for reading in self.readings
        ]
        return np.asarray(np.logaddexp.reduce(found, axis=0), np.float64)

    def clocks(self, lag_s: FloatArray) -> list[Clock]:
        """Estimate the clock offset at several lags, each under the reading that fits it best."""
        each = [self._clocks(reading, lag_s) for reading in self.readings]
        best = np.argmax([score for score, _ in each], axis=0)
        return [each[reading][1][i] for i, reading in enumerate(best)]

    def _clocks(self, reading: Reading, lag_s: FloatArray) -> tuple[FloatArray, list[Clock]]:
        """Scores and clock offsets of lags under one reading."""
        found = self._run(reading, lag_s, self._errors)
        weighed = self._weighed(found, self._errors)
        total = np.logaddexp.reduce(weighed.log_odds, axis=(0, 1))
        weight = np.exp(weighed.log_odds - total)
        offset = (weight * weighed.offset_hz).sum(axis=(0, 1))
        spread = weighed.var_hz2 + (weighed.offset_hz - offset) ** 2
        std = np.sqrt((weight * spread).sum(axis=(0, 1)))
        clocks = [Clock(float(o), float(s)) for o, s in zip(offset, std, strict=True)]
        return np.asarray(math.log(reading.share) + total, np.float64), clocks

    def _read(
        self,
        reading: Reading,
        lag_s: FloatArray,
        errors: Sequence[Errors],
        among: NDArray[np.bool_] | None = None,
    ) -> FloatArray:
        """Scores of lags under one reading of the reference."""
        found = self._run(reading, lag_s, errors, among)
        weighed = self._weighed(found, errors)
        score = np.logaddexp.reduce(weighed.log_odds, axis=(0, 1))
        linked = int(reading.clip.linked.sum())
        least = max(WORTHWHILE, self.settings.min_overlap * linked)
        return np.asarray(np.where(found.sums.count >= least, score, -np.inf), np.float64)

    def _run(
        self,
        reading: Reading,
        lag_s: FloatArray,
        errors: Sequence[Errors],
        among: NDArray[np.bool_] | None = None,
    ) -> _Run:
        clip = reading.clip
        phase, known = forecast(self.grid, lag_s, clip.t_s)
        known &= clip.linked[:, None]
        if among is not None:
            known &= among
        if (known == known[:, :1]).all():
            known = known[:, :1]
        block = blocks_of(clip)
        base, no_grid = np.zeros((2, int(block[-1]) + 1, known.shape[1]))
        of_each = reading.robust if self._robust else reading.generic
        np.add.at(base, block, of_each[:, None] * known)
        if self._robust:
            np.add.at(no_grid, block, reading.no_grid[:, None] * known)
            base = np.logaddexp(base + math.log1p(-BAD_SHARE), no_grid + math.log(BAD_SHARE))
        residual = clip.phase_rad[:, None] - phase
        return _Run(innovations(clip, residual, known, self.grid.step_s, errors), base)

    def _weighed(self, found: _Run, errors: Sequence[Errors]) -> _Weighed:
        """Evaluate lags for each size of the errors and of the clock error.

        If all blocks are good, the clock offset is Gaussian and integrated out. With bad blocks it
        is estimated from the good ones, whose weights depend on it (iteratively reweighted least
        squares).
        """
        weight = np.array([e.weight for e in errors])[:, None, None]
        share = np.array([share for share, _ in CLOCKS])[None, :, None]
        scale_hz = self.settings.clock_scale_ppm * 1e-6 * self.grid.nominal_hz
        var = np.array([(size * scale_hz) ** 2 for _, size in CLOCKS])[None, :, None]
        sums, prior = found.sums, np.log(weight * share)
        base = found.base
        if not self._robust:
            sums, base = sums.together(), base.sum(axis=0, keepdims=True)
        blocks = _Blocks(sums, base[:, None, None, :], var)
        log_odds, offset, tell = blocks.all_good()
        if base.shape[0] == 1:
            return _Weighed(prior + log_odds, offset, 1.0 / tell)
        plain = math.log(BAD_SHARES[0][0]) + log_odds
        for _ in range(CLOCK_PASSES):
            offset, tell = blocks.clock(blocks.good(offset, BAD_SHARE))
        bad = blocks.some_bad(offset)
        return _Weighed(prior + np.logaddexp(plain, bad), offset, 1.0 / tell)


class _Run(NamedTuple):
    """Innovations at some lags, and the log-likelihood of the same blocks under any grid.

    If blocks may be bad, the latter is a mixture with no grid.
    """

    sums: Innovations
    base: FloatArray


class _Weighed(NamedTuple):
    """Log-likelihood ratio against any grid, and clock offset; all (errors, clocks, lags)."""

    log_odds: FloatArray
    offset_hz: FloatArray
    var_hz2: FloatArray


class _Blocks:
    """Likelihoods of a clip's blocks at some lags; shapes (blocks, errors, clocks, lags).

    A bad block is as likely at a lag as under any grid, so a block can't count more against a lag
    than the prior odds that it is bad.
    """

    def __init__(self, sums: Innovations, base: FloatArray, clock_var: FloatArray) -> None:
        self._log_f, self._vv, self._vr, self._rr = (
            part[:, :, None, :] for part in (sums.log_f, sums.vv, sums.vr, sums.rr)
        )
        self._base, self._var = base, clock_var

    def all_good(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return log-likelihood ratio, clock offset and its precision if no block is bad."""
        log_f, vv, vr, rr = (
            part.sum(axis=0) for part in (self._log_f, self._vv, self._vr, self._rr)
        )
        tell = rr + 1.0 / self._var
        rss = vv - vr**2 / tell
        log_odds = -0.5 * (log_f + rss + np.log1p(self._var * rr)) - self._base.sum(axis=0)
        return log_odds, vr / tell, tell

    def clock(self, good: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the clock offset and its precision, with weights of the blocks."""
        tell = (good * self._rr).sum(axis=0) + 1.0 / self._var
        return (good * self._vr).sum(axis=0) / tell, tell

    def good(self, offset_hz: FloatArray, bad: float) -> FloatArray:
        """Probability that each block is good, with the prior share ``bad`` of bad blocks."""
        return np.asarray(1.0 / (1.0 + bad / (1.0 - bad) / self._odds(offset_hz)))

    def some_bad(self, offset_hz: FloatArray) -> FloatArray:
        """Log-likelihood ratio if some blocks are bad, averaged over the prior of their share."""
        odds = self._odds(offset_hz)
        occam = -0.5 * (offset_hz**2 / self._var + np.log1p(self._var * self._rr.sum(axis=0)))
        found = [
            math.log(weight) + np.log((1.0 - bad) * odds + bad).sum(axis=0)
            for weight, bad in BAD_SHARES[1:]
        ]
        return np.asarray(occam + np.logaddexp.reduce(found, axis=0), np.float64)

    def _odds(self, offset_hz: FloatArray) -> FloatArray:
        """Likelihood ratio of each block at a lag to any grid; 1 if none of its phases counts."""
        rss = self._vv - offset_hz * (2.0 * self._vr - offset_hz * self._rr)
        odds = -0.5 * (self._log_f + rss) - self._base
        return np.asarray(np.exp(np.clip(odds, -MOST_ODDS, MOST_ODDS, out=odds), out=odds))


def rougher(errors: Sequence[Errors], noise_hz: float) -> tuple[Errors, ...]:
    """Return error hypotheses with noise of the reference added (Hz, rms)."""
    return tuple(replace(e, reference_hz=math.hypot(e.reference_hz, noise_hz)) for e in errors)
