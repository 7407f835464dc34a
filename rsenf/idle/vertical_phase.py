"""Vertical phase analysis: the phase of every row's own series, and its slope down the rows.

Hajj-Ahmad, Berkovich & Wu, "Exploiting power signatures for camera forensics", IEEE Signal
Processing Letters 23, 713, 2016, in the form of the paper's comparison: the phase of row ``l`` at
the flicker's alias advances by ``2π·f_0·T_ro/L`` from row to row (paper, Eq. 23). With ``f_I`` rows
read in a second and ``N_c`` rows in a frame the idle ratio is ``1 − N_c·F_r/f_I`` (Eq. 24 has the
fraction inverted). Each row is fitted by itself, so a weak one unwraps wrongly; and at an alias of
0 Hz a row's flicker and its texture are the same.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.idle.estimator_state import EstimatorState, Finding
from rsenf.idle.jackknife import bends, freedom, left_out
from rsenf.idle.limits import (
    MIN_COHERENCE,
    NO_RAMP,
    STILL,
    WEAK,
    hardly_turned,
    is_weak,
    refused,
)
from rsenf.idle.row_tones import coherence, row_tones

Float = NDArray[np.float64]

AT_ZERO = refused(
    "the flicker's alias is at 0 Hz, where a row's flicker can't be told from texture"
)


def conclude(seen: EstimatorState) -> Finding:
    """Estimate from the slope of the rows' phases."""
    if seen.stands_still:
        return AT_ZERO
    if hardly_turned(seen):
        return STILL
    tone, level = row_tones(seen.moments)
    if is_weak(seen, 2.0 * float(np.abs(tone).mean() / level.mean())):
        return WEAK
    phase, weight = np.unwrap(np.angle(tone)), np.abs(tone) ** 2
    slope = _slopes(phase, weight[None, :])[0]
    if coherence(tone, level, float(slope) * phase.size / (2.0 * np.pi)) < MIN_COHERENCE:
        return NO_RAMP
    without = _slopes(phase, weight * left_out(phase.size))
    scale = phase.size / (2.0 * np.pi)
    jackknife_var = (len(without) - 1) * float(np.var(without))
    shapes = weight * bends(weight)
    bent = (shapes @ phase)[1:] / (shapes[0] @ bends(weight)[0])
    variance = max(jackknife_var * scale**2, float(np.mean(bent**2)) / (2.0 * np.pi) ** 2)
    return Finding.of_turns(float(slope) * scale, variance, seen.f0_hz, freedom(phase.size))


def _slopes(phase: Float, weight: Float) -> Float:
    """Weighted slopes of the phase by row number: (tries,) for weights (tries, rows)."""
    row = np.arange(phase.size)
    total = weight.sum(axis=1)
    place = row - (weight @ row / total)[:, None]
    return np.asarray(np.sum(weight * place * phase, axis=1) / np.sum(weight * place**2, axis=1))
