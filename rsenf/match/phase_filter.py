"""Likelihood of a clip's phases at a lag, from the innovations of a small Kalman filter.

Model: the observation is the clip's phase less the phase predicted from the reference. At the right
lag it is a random walk (the reference's errors are in its frequency), plus a bounded wander
(Ornstein-Uhlenbeck: from a codec, or where the reference is already an average), plus white noise.
For sums of frequencies the OU process is a frequency error, which drives the walk. The clock error
is a constant frequency offset and no state.

Likelihood: its logarithm is ``−½·Σ (log 2πF + (v − o·r)²/F)`` of the innovations ``v``, of variance
``F``. Filter and gains are linear, so the innovations ``r`` of a ramp of 1 Hz give it for every
offset ``o``. The sizes of the errors are unknown, so it is a mixture over several.

Approximate: the phase is known modulo a turn, and each innovation is reduced to the nearest turn.

References
----------
de Jong, P. (1991), The diffuse Kalman filter, Annals of Statistics 19.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsenf.match.clip_phase import RAD_PER_CYCLE, ClipPhase
from rsenf.messages.schema import FloatArray

UNKNOWN_RAD2 = 1e6  # diffuse variance of the phase, at the start and after a gap
MOST_KEPT = 3600  # phases of a clip whose gains are cached, in 6 MB
# A low bit rate makes the flicker's phase wander, by 0.02 to 0.16 rad in x264 clips of 50k to 150k.
# A reference averaged by a 20 s window has a similar effect: a day of the continental grid less its
# own average wanders by 0.061 rad, with a correlation of 0.5 after 6 s. (rad, s, weight)
_WANDERS = ((0.02, 5.0, 0.15), (0.06, 7.0, 0.15), (0.15, 10.0, 0.1))
# Errors of frequencies are correlated over 10 to 20 s, and two to five times as large as stated,
# sometimes more. (ratio, weight)
_RATIOS = ((1.0, 0.2), (2.0, 0.3), (4.0, 0.3), (8.0, 0.15), (16.0, 0.05))
_PLAIN = ((1e-4, 0.2), (3e-4, 0.35), (1e-3, 0.35), (2.5e-3, 0.1))
_WANDERING = ((3e-4, 0.6), (1.5e-3, 0.4))  # with a wander the reference's noise matters less
# Bad seconds come in runs: a block is good or bad as a whole. A long clip has longer blocks.
BLOCK_S = 10.0
MOST_BLOCKS = 64


@dataclass(frozen=True)
class ClipErrors:
    """One hypothesis on the size of a clip's errors, with its prior weight."""

    weight: float
    ratio: float  # true over stated standard deviation of the estimates
    # bounded wander of the phase: standard deviation and time constant; 0 for none
    wander_rad: float = 0.0
    wander_s: float = 1.0
    # time constant of the errors of frequencies that a phase is the sum of; 0 for white errors
    drift_s: float = 0.0


@dataclass(frozen=True)
class Errors:
    """One hypothesis on all errors: of the reference's 1 s mean frequency (Hz), and of the clip."""

    weight: float
    reference_hz: float
    clip: ClipErrors


CLIP_ERRORS = (
    *(ClipErrors(0.6 * w, ratio) for ratio, w in ((1.0, 0.6), (2.0, 0.3), (4.0, 0.1))),
    *(
        ClipErrors(w * v, ratio, rad, seconds)
        for rad, seconds, w in _WANDERS
        for ratio, v in ((1.0, 0.6), (2.5, 0.4))
    ),
)
SUM_ERRORS = (
    *(ClipErrors(0.3 * w, ratio) for ratio, w in ((1.0, 0.6), (2.0, 0.4))),
    *(
        ClipErrors(w * v, ratio, drift_s=seconds)
        for seconds, w in ((4.0, 0.25), (15.0, 0.45))
        for ratio, v in _RATIOS
    ),
)
ERRORS: tuple[Errors, ...] = tuple(
    Errors(clip.weight * w, hz, clip)
    for clip in CLIP_ERRORS
    for hz, w in (_WANDERING if clip.wander_rad else _PLAIN)
)
ERRORS_OF_SUMS: tuple[Errors, ...] = tuple(
    Errors(clip.weight * w, hz, clip) for clip in SUM_ERRORS for hz, w in _WANDERING
)


def clip_errors(clip: ClipPhase) -> tuple[ClipErrors, ...]:
    """Return the hypotheses on a clip's errors, which are the same at every lag."""
    return SUM_ERRORS if clip.is_summed else CLIP_ERRORS


def blocks_of(clip: ClipPhase) -> NDArray[np.int64]:
    """Return the block number of each phase, counted from 0."""
    since_s = clip.t_s - clip.t_s[0]
    length_s = max(BLOCK_S, (since_s[-1] + clip.hop_s) / MOST_BLOCKS)
    _, block = np.unique(since_s // length_s, return_inverse=True)
    return np.asarray(block, np.int64)


@dataclass(frozen=True, eq=False)
class Innovations:
    """Sums over the innovations ``v`` of the clip and ``r`` of a ramp of 1 Hz of the ENF.

    All have the shape (blocks, errors, lags); with ``F`` the innovations' variance, ``log_f`` is
    Σ log(2πF), ``vv`` Σ v²/F, ``vr`` Σ v·r/F, ``rr`` Σ r²/F. ``count`` (lags,) is the number of
    innovations.
    """

    log_f: FloatArray
    vv: FloatArray
    vr: FloatArray
    rr: FloatArray
    count: NDArray[np.int64]

    def together(self) -> Innovations:
        """Return the sums over all blocks, as one block."""
        log_f, vv, vr, rr = (
            part.sum(axis=0, keepdims=True) for part in (self.log_f, self.vv, self.vr, self.rr)
        )
        return Innovations(log_f, vv, vr, rr, self.count)


def innovations(
    clip: ClipPhase,
    residual_rad: FloatArray,
    known: NDArray[np.bool_],
    step_s: float,
    errors: Sequence[Errors] = ERRORS,
) -> Innovations:
    """Run the filter (de Jong 1991).

    Parameters
    ----------
    clip : ClipPhase
        With n phases.
    residual_rad : ndarray, shape (n, c)
        Clip's phase less the predicted phase, at each of c lags.
    known : ndarray of bool, shape (n, c) or (n, 1)
        Whether the reference gives the step from the phase before. If not, the filter is
        reinitialised, and that phase doesn't count.
    step_s : float
        Time step of the reference.
    errors : sequence of Errors
    """
    count = known.sum(axis=0)
    whole = ~known[:1].any(axis=0) & known[1:].all(axis=0)
    if whole.all() or not whole.any():
        return Innovations(*_sums(clip, residual_rad, known, step_s, errors), count)
    # Usually only a few lags reach beyond the reference; all others have the same known steps.
    one = _sums(clip, residual_rad[:, whole], known[:, whole][:, :1], step_s, errors)
    other = _sums(clip, residual_rad[:, ~whole], known[:, ~whole], step_s, errors)
    both = np.empty((len(one), *one[0].shape[:2], whole.size))
    for out, inside, beyond in zip(both, one, other, strict=True):
        out[..., whole], out[..., ~whole] = inside, beyond
    log_f, vv, vr, rr = both
    return Innovations(log_f, vv, vr, rr, count)


def _sums(
    clip: ClipPhase,
    residual_rad: FloatArray,
    known: NDArray[np.bool_],
    step_s: float,
    errors: Sequence[Errors],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return ``log_f``, ``vv``, ``vr`` and ``rr`` of :class:`Innovations`."""
    has_memory = [e.clip.wander_rad > 0.0 or e.clip.drift_s > 0.0 for e in errors]
    plain_first = np.argsort(has_memory, kind="stable")
    ordered = tuple(errors[e] for e in plain_first)
    is_whole = known.shape[1] == 1 and not known[:1].any() and known[1:].all()  # at all lags
    if is_whole and clip.size <= MOST_KEPT:
        foretold = _of_whole(clip, step_s, ordered)
    else:
        foretold = _Foretold(clip, known, step_s, ordered)
    size = (len(errors), residual_rad.shape[1])
    filtered = _Followed(size, foretold.wandering, foretold.shown)
    block = blocks_of(clip)
    vv, vr = np.zeros((2, int(block[-1]) + 1, *size))
    residual = residual_rad / (2.0 * np.pi)  # in turns, so that rint() below unwraps
    for b, value, step in zip(block, residual, foretold.steps, strict=True):
        v = filtered.innovation(value, step.keep, step.push)
        v -= np.rint(v)
        filtered.learn(v, step.gain)
        vr[b] += step.weighted_r * v
        v *= v
        v *= step.weight
        vv[b] += v
    back = np.argsort(plain_first)
    log_f, rr = foretold.log_f[:, back], foretold.rr[:, back]
    return log_f, (2 * np.pi) ** 2 * vv[:, back], 2 * np.pi * vr[:, back], rr


@functools.lru_cache(maxsize=2)
def _of_whole(clip: ClipPhase, step_s: float, errors: tuple[Errors, ...]) -> _Foretold:
    """Gains of a whole clip, cached: they are the same at all lags."""
    foretold = _Foretold(clip, np.arange(clip.size)[:, None] > 0, step_s, errors)
    foretold.steps = list(foretold.steps)
    return foretold


class _Step(NamedTuple):
    """Gains and variances for one phase, independent of the data; shapes as in :class:`_Spread`.

    ``push`` is the phase step for a drift of one standard deviation; None if nothing drifts.
    ``weight`` is one over the innovation's variance (0 where the phase doesn't count), and
    ``weighted_r`` that times the ramp's innovation.
    """

    keep: FloatArray
    push: FloatArray | None
    gain: tuple[FloatArray, FloatArray]
    weight: FloatArray
    weighted_r: FloatArray


class _Foretold:
    """Everything independent of the clip's phases; ``log_f``, ``rr`` are final after the steps."""

    def __init__(
        self, clip: ClipPhase, known: NDArray[np.bool_], step_s: float, errors: Sequence[Errors]
    ) -> None:
        spread = _Spread(clip, known.shape[1], step_s, errors)
        self.wandering, self.shown = spread.wandering, spread.shown
        self._block = blocks_of(clip)
        self.log_f, self.rr = np.zeros((2, int(self._block[-1]) + 1, *spread.shape))
        self.steps: Iterable[_Step] = self._steps(clip, known, spread)

    def _steps(self, clip: ClipPhase, known: NDArray[np.bool_], spread: _Spread) -> Iterator[_Step]:
        ramp = _Followed(spread.shape, spread.wandering, spread.shown)
        everywhere: NDArray[np.bool_] = np.all(known, axis=1)
        for i in range(clip.size):
            f, keep, push, gain = spread.step(i, None if everywhere[i] else known[i])
            weight, level = 1.0 / f, np.log(2.0 * np.pi * f)
            if not everywhere[i]:
                weight, level = np.where(known[i], weight, 0.0), np.where(known[i], level, 0.0)
            self.log_f[self._block[i]] += level
            r = ramp.innovation(RAD_PER_CYCLE * (clip.t_s[i] - clip.t_s[0]), keep, push)
            ramp.learn(r, gain)
            weighted_r = weight * r
            self.rr[self._block[i]] += weighted_r * r
            yield _Step(keep, push, gain, weight, weighted_r)


class _Spread:
    """Covariance recursion of the two states: the walk (a) and the wander (b).

    For errors with memory of summed frequencies, b is their drift: it isn't observed in the phase
    but drives the walk. Shapes are (errors, lags), or (errors, 1) if all lags have the same known
    steps. Arrays of b have only the rows of those errors that have such a state, which are the
    last.
    """

    def __init__(self, clip: ClipPhase, lags: int, step_s: float, errors: Sequence[Errors]) -> None:
        table = [
            (
                e.reference_hz, e.clip.ratio, 1.0 if e.clip.drift_s else e.clip.wander_rad,
                1.0 / (e.clip.drift_s or e.clip.wander_s), e.clip.drift_s > 0.0,
            )
            for e in errors
        ]  # fmt: skip
        q, ratio, wander, forget, drifts = (column[:, None] for column in np.array(table).T)
        self.shape = (len(errors), lags)
        self.wandering = slice(int((wander == 0.0).sum()), None)
        self.shown = 1.0 - drifts[self.wandering]
        dt = np.diff(clip.t_s, prepend=clip.t_s[0])[:, None, None]
        # Variance of the walk (rad²): the errors of the reference's samples are independent.
        self._grow = (RAD_PER_CYCLE * q) ** 2 * step_s * dt
        self._grow += (1.0 - drifts) * ratio**2 * clip.walk_rad2[:, None, None]
        push = (drifts * ratio)[self.wandering] * np.sqrt(clip.walk_rad2)[:, None, None]
        self._push = push if drifts.any() else None
        self._noise = ratio**2 * clip.var_rad2[:, None, None] + 1e-12
        self._keep = np.exp(-forget[self.wandering] * dt)
        self._wander = wander[self.wandering] ** 2
        self._aa = np.full(self.shape, UNKNOWN_RAD2)
        self._bb = self._wander + np.zeros(self._aa[self.wandering].shape)
        self._ab = np.zeros_like(self._bb)

    def step(
        self, i: int, known: NDArray[np.bool_] | None
    ) -> tuple[FloatArray, FloatArray, FloatArray | None, tuple[FloatArray, FloatArray]]:
        """Predict and update for phase ``i``; ``known`` (lags,) marks known steps, None if all are.

        Returns
        -------
        f : ndarray
            Variance of the innovation.
        keep : ndarray
            Decay of the wander state; 0 where the filter is reinitialised.
        push : ndarray or None
            As in :class:`_Step`.
        gain : tuple of ndarray
            Kalman gains of the walk and of the wander.
        """
        aa, ab, bb, keep = self._aa, self._ab, self._bb, self._keep[i]
        aa += self._grow[i]
        if known is not None:
            # After a gap the phase is unknown and the wander restarts, but a drift goes on.
            keep = np.where(known, keep, (1.0 - self.shown) * keep)
            aa[:, ~known], ab[:, ~known] = UNKNOWN_RAD2, 0.0
        ab *= keep
        bb -= self._wander
        bb *= keep**2
        bb += self._wander
        push = None if self._push is None else self._push[i]
        if push is not None:
            aa[self.wandering] += push * (2.0 * ab + push * bb)
            ab += push * bb
        to_a, to_b = aa.copy(), ab + self.shown * bb
        to_a[self.wandering] += self.shown * ab
        f = to_a + self._noise[i]
        f[self.wandering] += self.shown * to_b
        gain_a, gain_b = to_a / f, to_b / f[self.wandering]
        ab -= gain_a[self.wandering] * to_b
        aa -= gain_a * to_a
        bb -= gain_b * to_b
        return f, keep, push, (gain_a, gain_b)


class _Followed:
    """State estimates (walk and wander) of a series."""

    def __init__(self, shape: tuple[int, int], wandering: slice, shown: FloatArray) -> None:
        self._a, self._wandering, self._shown = np.zeros(shape), wandering, shown
        self._b = np.zeros_like(self._a[wandering])

    def innovation(
        self, value: FloatArray | float, keep: FloatArray, push: FloatArray | None
    ) -> FloatArray:
        """Predict, and return the next value less its prediction."""
        self._b *= keep
        if push is not None:
            self._a[self._wandering] += push * self._b
        v: FloatArray = value - self._a
        v[self._wandering] -= self._b if push is None else self._shown * self._b
        return v

    def learn(self, v: FloatArray, gain: tuple[FloatArray, FloatArray]) -> None:
        """Update the states with an innovation."""
        self._a += gain[0] * v
        self._b += gain[1] * v[self._wandering]
