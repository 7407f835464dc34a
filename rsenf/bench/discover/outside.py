"""Effects that no catalogue has, done to row means by plain array arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np

from rsenf.model.scene import Float32Array

Do = Callable[[Float32Array, np.ndarray, np.random.Generator], Float32Array]


def shaken(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """A mechanical shake of the picture by parts of a row, with a gain."""
    swing = np.sin(2 * np.pi * rng.uniform(2.0, 11.0) * t_s + rng.uniform(0, 6))
    moved = level + 0.2 * swing * (np.roll(level, 1, axis=1) - level)
    return np.asarray(moved * (1 + 0.001 * swing))


def brightened(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """From some moment on, all is a little brighter."""
    since = t_s > rng.uniform(0.3, 0.7) * t_s.max()
    return np.asarray(level * np.where(since, 1.01, 1.0))


def shaded(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """Something dark pulsates over the lower third."""
    lower = np.arange(level.shape[1])[:, None] > 2 * level.shape[1] // 3
    pulse = 0.005 * (1 + np.cos(2 * np.pi * rng.uniform(0.5, 4.0) * t_s)) ** 2
    return np.asarray(level * (1 - pulse * lower))


def clipped(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """The brightest have no room: what is above some level bends over."""
    knee = np.quantile(level, rng.uniform(0.6, 0.8))
    return np.asarray(np.where(level > knee, knee + 0.3 * (level - knee), level))


def sawn(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """A gain that rises and falls back, again and again."""
    saw = (rng.uniform(0.3, 1.5) * t_s) % 1.0
    return np.asarray(level * (1 + 0.006 * (saw - 0.5)))


def beaten(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """Every few seconds a frame has some of the one before in it."""
    every = int(rng.integers(40, 90))
    out = level.copy()
    out[every::every] = 0.6 * level[every::every] + 0.4 * level[every - 1 : -1 : every]
    return out


OUTSIDE: dict[str, Do] = {
    "shaken": shaken,
    "brightened": brightened,
    "shaded": shaded,
    "clipped": clipped,
    "sawn": sawn,
    "beaten": beaten,
}


# What the catalogue has under another name: a gain of any course is one.
LIKE = {"brightened": "auto_exposure", "sawn": "auto_exposure"}


def done_to(
    name: str, level: Float32Array, rate: Fraction, rng: np.random.Generator
) -> Float32Array:
    """Do one of them to row means (frames, lines, strips)."""
    t_s = np.arange(level.shape[0])[:, None, None] / float(rate)
    return OUTSIDE[name](level, t_s, rng).astype(np.float32)
