"""Of which form a course over time is: even, exponential, periodic, in steps, or a random walk.

The simplest form that leaves little of the course's variance is its form, with its parameters; the
walk is an Ornstein–Uhlenbeck process, and is what any other course is called.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from rsenf.messages.schema import FloatArray

LEAVES = 0.1  # of the variance, at most, by a course of a form
MOST_STEPS = 12
LAG_S = 0.5  # at which a walk is compared with itself


def form_of(t_s: FloatArray, values: FloatArray) -> dict[str, Any]:
    """Name the form of a course.

    Parameters
    ----------
    t_s : ndarray (values,)
        Rising, about equally far apart.
    values : ndarray (values,)

    Returns
    -------
    dict
        ``form`` and its parameters, plain values; ``leaves``, the share of the variance that such
        a form leaves, the values' own noise taken off (as their steps from one to the next show
        it); of a walk ``rms`` and ``time_constant_s``.
    """
    away = values - values.mean()
    noise = 0.5 * float(np.mean(np.diff(away) ** 2))
    power = max(float(np.mean(away**2)) - noise, 1e-30)
    for form in (_even, _exponential, _periodic, _steps):
        fitted, told = form(t_s - t_s[0], away)
        leaves = max(float(np.mean((away - fitted) ** 2)) - noise, 0.0) / power
        if leaves < LEAVES:
            return {"form": form.__name__[1:], **told, "leaves": leaves}
    rms, time_constant_s = float(np.sqrt(power)), _forgets_in_s(t_s, away)
    return {"form": "random walk", "rms": rms, "time_constant_s": time_constant_s}


def _forgets_in_s(t_s: FloatArray, away: FloatArray) -> float:
    """Time constant of a walk, from its covariance at two lags: noise has none there."""
    step_s = float(np.median(np.diff(t_s)))
    lag = max(round(LAG_S / step_s), 1)
    near, far = (float(away[n:] @ away[:-n]) / (away.size - n) for n in (lag, 2 * lag))
    stays = min(max(far / max(near, 1e-30), 1e-6), 1.0 - 1e-6)
    return -lag * step_s / float(np.log(stays))


Fitted = tuple[FloatArray, dict[str, Any]]


def _least_squares(values: FloatArray, *shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    matrix = np.column_stack([np.ones(values.size), *shapes])
    weights = np.linalg.lstsq(matrix, values, rcond=None)[0]
    return np.asarray(matrix @ weights), np.asarray(weights)


def _even(t_s: FloatArray, values: FloatArray) -> Fitted:
    fitted, weights = _least_squares(values, t_s)
    return fitted, {"rise_per_min": 60.0 * float(weights[1])}


def _exponential(t_s: FloatArray, values: FloatArray) -> Fitted:
    """Try time constants from a thirtieth of the time to three times as long."""
    tries = []
    for constant_s in float(t_s[-1]) * np.geomspace(1 / 30, 3.0, 60):
        fitted, weights = _least_squares(values, np.exp(-t_s / constant_s))
        left = float(np.sum((values - fitted) ** 2))
        tries.append((left, constant_s, fitted, float(weights[1])))
    _, constant_s, fitted, size = min(tries, key=lambda one: one[0])
    return fitted, {"time_constant_s": float(constant_s), "size": size}


def _periodic(t_s: FloatArray, values: FloatArray) -> Fitted:
    """Try a tone and its second harmonic, near the strongest line."""
    step_s = float(t_s[-1]) / (t_s.size - 1)
    power = np.abs(np.fft.rfft(values, 8 * values.size)) ** 2
    freq_hz = np.fft.rfftfreq(8 * values.size, step_s)
    first = 4  # slower than half a turn is no period
    peak = first + int(np.argmax(power[first:]))
    angle = 2.0 * np.pi * freq_hz[peak] * t_s
    shapes = [wave(k * angle) for k in (1, 2) for wave in (np.cos, np.sin)]
    fitted, weights = _least_squares(values, *shapes)
    return fitted, {"freq_hz": float(freq_hz[peak]), "size": float(np.hypot(*weights[1:3]))}


def _steps(t_s: FloatArray, values: FloatArray) -> Fitted:
    """Cut where a step explains most, again and again (binary segmentation)."""
    edges = [0, values.size]
    while len(edges) < MOST_STEPS + 2:
        best = max((_best_cut(values[a:b]), a) for a, b in pairwise(edges))
        (gain, at), begin = best
        if gain < 0.01 * float(np.sum(values**2)):
            break
        edges = sorted([*edges, begin + at])
    fitted = np.concatenate([
        np.full(b - a, values[a:b].mean()) for a, b in pairwise(edges)
    ])  # fmt: skip
    return fitted, {"at_s": [float(t_s[n]) for n in edges[1:-1]]}


def _best_cut(values: FloatArray) -> tuple[float, int]:
    """How much one step explains of a piece at most, and where it is."""
    if values.size < 4:
        return 0.0, 0
    away, before = np.cumsum(values - values.mean())[:-1], np.arange(1, values.size)
    gain = away**2 * values.size / (before * (values.size - before))
    at = int(np.argmax(gain))
    return float(gain[at]), at + 1
