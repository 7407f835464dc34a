"""Likelihood of a clip's phases at a lag: the innovations of a small Kalman filter.

What is filtered is the clip's phase less the forecast of the reference. At the right lag three
things are left: a random walk, for the reference's errors are in its frequency; a bounded wander,
by a codec, or where the reference is an average over a window already; and the clip's own noise. A
constant offset in frequency, the clock's error, is no state of the filter: filter and gains are
linear, so the same run over a ramp of 1 Hz tells the likelihood of every offset (the augmented
filter of de Jong, Annals of Statistics 19, 1991).

All lags are run side by side, under several sizes of the errors each. The sizes aren't known, so
the likelihood is the mean over them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.match.clip_phase import RAD_PER_CYCLE, ClipPhase
from rsenf.messages.schema import FloatArray

UNKNOWN_RAD2 = 1e6  # of a phase after a gap


@dataclass(frozen=True)
class ClipErrors:
    """One size of a clip's errors, with its prior weight.

    Parameters
    ----------
    weight : float
    ratio : float
        Of the noise of each second over what its estimate claims.
    wander_rad, wander_s : float
        Bounded wander of the phase: standard deviation and memory; 0 for none.
    """

    weight: float
    ratio: float
    wander_rad: float = 0.0
    wander_s: float = 1.0


@dataclass(frozen=True)
class Errors:
    """One size of all errors: of the reference's mean over a second (Hz), and of the clip."""

    weight: float
    reference_hz: float
    clip: ClipErrors


# A codec at a low bit rate makes the flicker's phase wander, by 0.02 to 0.16 rad in x264 clips of
# 50k to 150k. A reference that was averaged by a 20 s window differs likewise: a day of the
# continental grid less its own average wanders by 0.061 rad, with a correlation of 0.5 after 6 s.
_WANDERS = ((0.02, 5.0, 0.15), (0.06, 7.0, 0.15), (0.15, 10.0, 0.1))
CLIP_ERRORS = (
    *(ClipErrors(0.6 * w, ratio) for ratio, w in ((1.0, 0.6), (2.0, 0.3), (4.0, 0.1))),
    *(
        ClipErrors(w * v, ratio, rad, seconds)
        for rad, seconds, w in _WANDERS
        for ratio, v in ((1.0, 0.6), (2.5, 0.4))
    ),
)
_PLAIN = ((1e-4, 0.2), (3e-4, 0.35), (1e-3, 0.35), (2.5e-3, 0.1))
_WANDERING = ((3e-4, 0.6), (1.5e-3, 0.4))  # beside a wander the reference's noise matters less
ERRORS: tuple[Errors, ...] = tuple(
    Errors(clip.weight * w, hz, clip)
    for clip in CLIP_ERRORS
    for hz, w in (_WANDERING if clip.wander_rad else _PLAIN)
)


@dataclass(frozen=True, eq=False)
class Innovations:
    """Sums over the innovations ``v`` of the clip and ``r`` of a ramp of 1 Hz of the ENF.

    All of shape (errors, lags), with ``F`` the innovations' variance: ``log_f`` is Σ log(2πF),
    ``vv`` Σ v²/F, ``vr`` Σ v·r/F, ``rr`` Σ r²/F. ``count`` (lags,) is how many there are.
    """

    log_f: FloatArray
    vv: FloatArray
    vr: FloatArray
    rr: FloatArray
    count: NDArray[np.int64]


def innovations(
    clip: ClipPhase,
    residual_rad: FloatArray,
    known: NDArray[np.bool_],
    step_s: float,
    errors: Sequence[Errors] = ERRORS,
) -> Innovations:
    """Run the filter.

    Parameters
    ----------
    clip : ClipPhase
        Of n phases.
    residual_rad : ndarray, shape (n, c)
        Clip's phase less the forecast, at each of c lags.
    known : ndarray of bool, shape (n, c) or (n, 1)
        Whether the reference tells the way from the phase before. Where it doesn't, the filter
        starts anew, and that phase counts for nothing.
    step_s : float
        Of the reference.
    errors : sequence of Errors
    """
    table = np.array(
        [[e.reference_hz, e.clip.ratio, e.clip.wander_rad, 1.0 / e.clip.wander_s] for e in errors]
    )
    q, ratio, wander, forget = (column[:, None] for column in table.T)
    q = (RAD_PER_CYCLE * q) ** 2 * step_s  # rad² a second: errors of samples are independent
    ratio2, wander2 = ratio**2, wander**2
    size = (len(errors), residual_rad.shape[1])
    # Covariance of the walk (a) and the wander (b); states of the clip (x) and of the ramp (s).
    paa = np.full((len(errors), known.shape[1]), UNKNOWN_RAD2)
    pab, pbb = np.zeros_like(paa), np.broadcast_to(wander2, paa.shape)
    xa, xb, sa, sb = (np.zeros(shape) for shape in (size, size, paa.shape, paa.shape))
    log_f, rr = np.zeros(paa.shape), np.zeros(paa.shape)
    vv, vr = np.zeros(size), np.zeros(size)
    dt = np.diff(clip.t_s, prepend=clip.t_s[0])
    for i in range(clip.size):
        keep = np.exp(-forget * dt[i])
        paa = paa + q * dt[i] + ratio2 * clip.walk_rad2[i]
        pab, pbb = pab * keep, pbb * keep**2 + wander2 * (1 - keep**2)
        xb, sb = xb * keep, sb * keep
        anew = ~known[i]
        if anew.any():
            paa = np.where(anew, UNKNOWN_RAD2, paa)
            pab, pbb = np.where(anew, 0.0, pab), np.where(anew, wander2, pbb)
            xb, sb = np.where(anew, 0.0, xb), np.where(anew, 0.0, sb)
        ga, gb = paa + pab, pab + pbb
        f = ga + gb + ratio2 * clip.var_rad2[i] + 1e-12
        v = residual_rad[i] - xa - xb
        v -= 2 * np.pi * np.round(v / (2 * np.pi))
        r = RAD_PER_CYCLE * (clip.t_s[i] - clip.t_s[0]) - sa - sb
        told = np.where(anew, 0.0, 1.0 / f)
        log_f += np.where(anew, 0.0, np.log(2 * np.pi * f))
        vv, vr, rr = vv + v * v * told, vr + v * r * told, rr + r * r * told
        ka, kb = ga / f, gb / f
        xa, xb, sa, sb = xa + ka * v, xb + kb * v, sa + ka * r, sb + kb * r
        paa, pab, pbb = paa - ka * ga, pab - ka * gb, pbb - kb * gb
    return Innovations(log_f, vv, vr, rr, known.sum(axis=0))
