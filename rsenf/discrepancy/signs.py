"""What is left of a recording, measured in ways that tell one kind of cause from another.

Everything is a share of the systematic residual, from products of neighbouring rows as the gap is,
so noise has none of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.gap import products
from rsenf.discrepancy.measured import Float32Array
from rsenf.discrepancy.series import halves, power
from rsenf.messages.schema import FloatArray
from rsenf.model.parameters import Fitting

EACH_FRAME = Fitting(0.0, 1.0, each="frame")
LEVELS = 32  # steps of the curve by level
BIN_S = 0.5  # in which events are looked for
EDGE = 5  # frames at either end, in which a change would be of few frames
LONGEST_S = 4.0  # period that is looked for
REPEATS, DIPS = 0.7, 0.5  # correlation a period apart, and what it must have fallen below between


@dataclass(frozen=True, eq=False)
class Series:
    """What one number for each frame would explain.

    Attributes
    ----------
    share : float
        Of what is left.
    stays : float
        Correlation of one frame's number with the next one's: 0 is by chance, 1 is slow.
    changed : float
        Share of the numbers' variance that one lasting change explains.
    changed_s : float
        When that would be.
    period_frames : int
        After how many frames the numbers come again; 0 where they don't.
    """

    share: float
    stays: float
    changed: float
    changed_s: float
    period_frames: int


@dataclass(frozen=True, eq=False)
class Signs:
    """What tells causes apart.

    Attributes
    ----------
    gain, timing, flicker_size : Series
        All of a frame brighter; its light later; its flicker larger.
    level : float
        Share that is a curve over the level that the theory foretells.
    common : float
        Share that all strips have in common; one where there is one strip.
    burst_s : tuple of float
        Middles of the half seconds that hold half of what is left, if these are few; else empty.
    """

    gain: Series
    timing: Series
    flicker_size: Series
    level: float
    common: float
    burst_s: tuple[float, ...]


def signs_of(fit: Fit) -> Signs:
    """Measure what a fit leaves."""
    first, second = fit.data.halves(fit.residual)
    total = float((first * second).sum(dtype=np.float64)) or 1e-30
    strips = first.shape[2] * (first.mean(axis=2) * second.mean(axis=2)).sum(dtype=np.float64)
    return Signs(
        _series(fit, fit.slopes.lit, total),
        _series(fit, fit.slopes.turn, total),
        _series(fit, fit.flicker, total),
        _by_level(fit, first, second) / total,
        float(strips) / total,
        _bursts(fit),
    )


def _series(fit: Fit, direction: Float32Array, total: float) -> Series:
    """Weigh a direction with a size of its own in each frame, found on either half of the rows."""
    lit, data = fit.slopes.lit, fit.data
    a, b = halves(direction, fit.residual, lit, data, EACH_FRAME)
    # Half of the power is that of one row in two.
    share = float((a * b * power(direction, lit, EACH_FRAME)).sum()) / 2.0 / total
    a, b = a - a.mean(), b - b.mean()
    own = float(a @ b)
    if own <= 0.0:
        return Series(share, 0.0, 0.0, 0.0, 0)
    changed, at = _change(a, b)
    apart = _apart(a, b, math.ceil(LONGEST_S * float(data.frame_rate))) / own
    at_s = float(data.time_s[at])
    return Series(share, float(apart[1]), changed / own, at_s, _period(apart))


def _change(a: FloatArray, b: FloatArray) -> tuple[float, int]:
    """What one lasting change explains of two centred series at most, and where it is."""
    before = np.arange(1, a.size)
    told = np.cumsum(a)[:-1] * np.cumsum(b)[:-1] * a.size / (before * (a.size - before))
    at = int(np.argmax(told[EDGE:-EDGE])) + EDGE
    return float(told[at]), at + 1


def _apart(a: FloatArray, b: FloatArray, most: int) -> FloatArray:
    """Products of two series so many frames apart, as many as there would be if none were lost."""
    size = a.size
    return np.array([(a[n:] @ b[: size - n]) * size / (size - n) for n in range(min(most, size))])


def _period(apart: FloatArray) -> int:
    """Frames after which a series comes again, having been something else between."""
    fallen = np.flatnonzero(apart < DIPS)
    inner = apart[1:-1]
    peaks = (inner > REPEATS) & (inner >= apart[:-2]) & (inner >= apart[2:])
    again = 1 + np.flatnonzero(peaks)
    again = again[again > fallen[0]] if fallen.size else again[:0]
    return int(again[0]) if again.size else 0


def _by_level(fit: Fit, first: Float32Array, second: Float32Array) -> float:
    """Sum of the products that a curve over the foretold level explains."""
    edges = np.quantile(fit.rows, np.linspace(0.0, 1.0, LEVELS + 1)[1:-1])
    means, counts = [], []
    for rows, left in zip(fit.data.halves(fit.rows), (first, second), strict=True):
        own = np.digitize(rows, edges).ravel()
        counts.append(np.bincount(own, minlength=LEVELS))
        means.append(np.bincount(own, left.ravel(), LEVELS) / np.maximum(counts[-1], 1))
    return float((means[0] * means[1] * counts[0]).sum())


def _bursts(fit: Fit) -> tuple[float, ...]:
    number = (fit.data.time_s // BIN_S).astype(np.intp)
    held = np.bincount(number, products(fit.residual, fit.data))
    order = np.argsort(-held)
    few = int(np.argmax(np.cumsum(held[order]) >= held.sum() / 2.0)) + 1
    if held.sum() <= 0.0 or few > held.size // 10:
        return ()
    return tuple(float(n + 0.5) * BIN_S for n in np.sort(order[:few]))
