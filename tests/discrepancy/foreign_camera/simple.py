"""A rolling-shutter camera in plain NumPy, which shares no code with rsenf's own model."""

from __future__ import annotations

import numpy as np

RATE_HZ, LINES, READ_OUT_S = 30000 / 1001, 150, 0.0231
NOISE_LEVEL = 0.1


def film(
    seed: int,
    seconds: float = 27.0,
    *,
    other_lamp: float = 0.0,
    tone: tuple[float, float] = (0.0, 0.0),
    jitter_s: float = 0.0,
    lost: tuple[int, ...] = (),
    stroll_hz: float = 0.002,
) -> tuple[np.ndarray, np.ndarray]:
    """Film a wall under a lamp on a 50 Hz grid.

    Parameters
    ----------
    seed : int
    seconds : float
    other_lamp : float
        Share of the light in the right half that is a lamp's on another of the three phases.
    tone : tuple
        Frequency (Hz) and relative size of a flicker that isn't the mains'.
    jitter_s : float
        By which frames begin early or late, rms; their stamps don't say so.
    lost : tuple of int
        Frames that never arrive; the stamps of the others close up.
    stroll_hz : float
        By which the grid's frequency kinks each half second, rms. A real one has inertia, and
        changes by 0.001 in a second, without kinks.

    Returns
    -------
    ndarray (frames, lines, 2)
        Means of the left and the right half of each line.
    ndarray (frames,)
        Stamps, seconds.
    """
    rng = np.random.default_rng(seed)
    frames = round(seconds * RATE_HZ) + len(lost)
    start_s = np.arange(frames) / RATE_HZ + jitter_s * rng.standard_normal(frames)
    t_s = start_s[:, None] + np.arange(LINES) * READ_OUT_S / LINES
    twice = 2 * np.interp(t_s + 0.3, *_turns(rng, seconds, stroll_hz)) * 2 * np.pi
    lamp = 1 + 0.08 * np.cos(twice)
    other = 1 + 0.08 * np.cos(twice + 2 * np.pi / 3)
    hum = 1 + tone[1] * np.cos(2 * np.pi * tone[0] * t_s + 1.0)
    light = np.stack([lamp, (1 - other_lamp) * lamp + other_lamp * other], axis=2) * hum[..., None]
    wall = 90 + 12 * np.sin(np.arange(LINES) / 9.0)[:, None] + np.array([0.0, 8.0])
    wall += rng.uniform(-2, 2, wall.shape)
    seen = wall * light + NOISE_LEVEL * rng.standard_normal(light.shape)
    arrived = np.delete(seen, lost, axis=0)
    return arrived, np.arange(len(arrived)) / RATE_HZ


def true_hz(
    seed: int, begin_s: np.ndarray, end_s: np.ndarray, *, seconds: float, stroll_hz: float
) -> np.ndarray:
    """Mean frequency of the grid of such a film, with no frame lost, over intervals of it."""
    rng = np.random.default_rng(seed)
    rng.standard_normal(round(seconds * RATE_HZ))  # of the frames' jitter
    fine_s, turns = _turns(rng, seconds, stroll_hz)
    begin, end = (np.interp(t_s + 0.3, fine_s, turns) for t_s in (begin_s, end_s))
    return (end - begin) / (end_s - begin_s)


def _turns(
    rng: np.random.Generator, seconds: float, stroll_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times and turns of the grid: it strolls about 50 Hz and is drawn back, each half second."""
    away_hz, walk = 0.0, []
    for _ in range(2 * int(seconds) + 20):
        away_hz = 0.99 * away_hz + stroll_hz * rng.standard_normal()
        walk.append(50.01 + away_hz)
    fine_s = np.arange(0.0, len(walk) / 2 - 1.0, 0.01)
    freq_hz = np.interp(fine_s, np.arange(len(walk)) / 2, walk)
    return fine_s, np.concatenate([[0.0], np.cumsum((freq_hz[1:] + freq_hz[:-1]) / 2 * 0.01)])
