"""Courses over time, of mean zero and rms one, that effects take."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from .light import Array


def unit(course: Array) -> Array:
    """Without its mean, and of rms one."""
    away = course - course.mean()
    return np.asarray(away / np.sqrt(np.mean(away**2)))


def stroll(rng: np.random.Generator, t_s: Array, time_s: float, *, smooth_s: float = 0.0) -> Array:
    """Draw an Ornstein-Uhlenbeck course of a correlation time, made smooth over another."""
    step_s = float(t_s[1] - t_s[0])
    settle = int(5 * time_s / step_s)
    noise = rng.standard_normal(settle + len(t_s))
    course = lfilter([1.0], [1.0, -np.exp(-step_s / time_s)], noise)[settle:]
    if smooth_s:
        course = gaussian_filter1d(course, smooth_s / step_s, mode="nearest")
    return unit(course)


def linear(rng: np.random.Generator, t_s: Array) -> Array:
    """Straight up or down."""
    return unit(t_s) * float(rng.choice([-1.0, 1.0]))


def settling(rng: np.random.Generator, t_s: Array) -> Array:
    """Towards a value exponentially, in a fifth to one of the film's length."""
    time_s = rng.uniform(0.2, 1.0) * (t_s[-1] - t_s[0])
    return unit(np.exp(-(t_s - t_s[0]) / time_s)) * float(rng.choice([-1.0, 1.0]))


def swing(rng: np.random.Generator, t_s: Array) -> Array:
    """One to four slow waves in the film, with a little of their second harmonic."""
    angle = 2 * np.pi * rng.uniform(1.0, 4.0) * t_s / (t_s[-1] - t_s[0]) + rng.uniform(0, 6.28)
    return unit(np.sin(angle) + rng.uniform(0, 0.3) * np.sin(2 * angle + rng.uniform(0, 6.28)))


def wander(rng: np.random.Generator, t_s: Array) -> Array:
    """Draw a random walk that is drawn back in 5 to 30 s, smooth over half a second or more."""
    return stroll(rng, t_s, rng.uniform(5.0, 30.0), smooth_s=rng.uniform(0.5, 2.0))


def steps(rng: np.random.Generator, t_s: Array) -> Array:
    """Small steps every few seconds, each smoothed over 1 to 3 s."""
    many = max(3, int((t_s[-1] - t_s[0]) / 8.0))
    at = rng.uniform(t_s[0], t_s[-1], many)
    width_s = rng.uniform(1.0, 3.0, many) / 4.0
    return unit((rng.standard_normal(many) * np.tanh((t_s[:, None] - at) / width_s)).sum(axis=1))


def hunting(rng: np.random.Generator, t_s: Array) -> Array:
    """A regulation that swings about its aim at 0.2 to 1.5 Hz, in bouts."""
    bouts = 1.0 + 0.7 * wander(rng, t_s)
    phase = 2 * np.pi * rng.uniform(0.2, 1.5) * t_s + 0.3 * wander(rng, t_s)
    return unit(bouts * np.sin(phase + rng.uniform(0, 6.28)))


def drawn(
    rng: np.random.Generator,
    t_s: Array,
    kinds: tuple[Callable[[np.random.Generator, Array], Array], ...],
) -> tuple[Array, str]:
    """Draw one of some kinds of course, and its name."""
    kind = kinds[int(rng.integers(len(kinds)))]
    return kind(rng, t_s), kind.__name__
