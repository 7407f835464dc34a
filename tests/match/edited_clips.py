"""Clips with phases whose truth is known piece by piece: cut, looped, joined, at another speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.bench.calibration.searches import true_phase
from rsenf.match.clip_phase import RAD_PER_CYCLE
from rsenf.match.series import Grid, Track

STEPS = 10  # of a second, over which its phase is averaged
SMEAR_S = 1.4  # over which coherent projection spreads a jump of the phase in its frequencies
SMOOTH_S = 15


@dataclass(frozen=True, eq=False)
class Piece:
    """Some seconds of a grid's time."""

    stretch: Grid
    start_s: float
    seconds: float


@dataclass(frozen=True)
class Quality:
    """How well a clip shows its light.

    The phase of a second is off by ``noise_rad``, of which the estimator claims only a part; the
    clock is fast by ``clock_ppm``, and a clip played at 1.01 times its speed has one that is slow.
    """

    noise_rad: float = 0.02
    claimed_ratio: float = 1.5
    clock_ppm: float = 0.0


PLAIN = Quality()


def edited_clip(pieces: Sequence[Piece], seed: int, quality: Quality = PLAIN) -> Track:
    """A track of a clip that shows pieces of time one after the other."""
    rng = np.random.default_rng(seed)
    seconds = int(sum(piece.seconds for piece in pieces))
    t_s = (np.arange(seconds * STEPS) + 0.5) / STEPS
    light, away, jumps, begin_s = np.empty(t_s.size, complex), np.empty(t_s.size), [], 0.0
    for piece in pieces:
        own = (t_s >= begin_s) & (t_s < begin_s + piece.seconds)
        since_s = t_s[own] - begin_s
        phase = true_phase(piece.stretch, piece.start_s, since_s, quality.clock_ppm)
        first = int(np.flatnonzero(own)[0])
        light[own] = np.exp(1j * (phase + rng.uniform(0, 2 * np.pi)))
        away[own] = np.gradient(phase, since_s) / RAD_PER_CYCLE
        if first:
            jumps.append((begin_s, np.angle(light[first] / light[first - 1])))
        begin_s += piece.seconds
    centre_s = np.arange(seconds) + 0.5
    errors = quality.noise_rad * rng.standard_normal(seconds)
    wrong = _frequency_errors(errors, quality.noise_rad)
    enf = pieces[0].stretch.nominal_hz + away.reshape(-1, STEPS).mean(axis=1) + wrong
    for at_s, jump in jumps:
        bump = np.exp(-(((centre_s - at_s) / SMEAR_S) ** 2) / 2) / (SMEAR_S * np.sqrt(2 * np.pi))
        enf = enf + jump / RAD_PER_CYCLE * bump
    phase = np.angle(light.reshape(-1, STEPS).mean(axis=1) * np.exp(1j * errors))
    claimed = quality.noise_rad / quality.claimed_ratio
    variance = max(wrong.std(), 2e-5) ** 2
    return Track(
        first_s=0.5,
        hop_s=1.0,
        window_s=1.0,
        enf_hz=enf,
        var_hz2=np.full(seconds, variance),
        nominal_hz=pieces[0].stretch.nominal_hz,
        phase_rad=phase,
        phase_var_rad2=np.full(seconds, claimed**2),
    )


def _frequency_errors(errors, noise_rad):
    """An estimator's errors of frequency: it smooths the phase the more, the noisier it is."""
    width_s = max(0.3, 1.5 * np.sqrt(noise_rad / 0.02))
    t_s = np.arange(-SMOOTH_S, SMOOTH_S + 1)
    weights = np.exp(-((t_s / width_s) ** 2) / 2)
    padded = np.pad(errors, SMOOTH_S, mode="edge")
    smooth = np.convolve(padded, weights / weights.sum(), "valid")
    return np.gradient(smooth) / RAD_PER_CYCLE


def reference_of(stretch: Grid, seed: int, *, t0_ns=0, noise_hz=3e-4) -> Grid:
    """The stretch as somebody else would have measured it, to a tenth of a millihertz."""
    noise = np.random.default_rng(seed).standard_normal(stretch.freq_hz.size)
    freq = stretch.freq_hz + noise_hz / np.sqrt(stretch.step_s) * noise
    return Grid(stretch.name, stretch.nominal_hz, t0_ns, stretch.step_s, np.round(freq, 4))


def measured_start(stretch: Grid, seconds: float, rng) -> float:
    """A start after which, and a little before, so many seconds were measured."""
    margin = 30.0 * stretch.step_s
    while True:
        start_s = rng.uniform(margin, stretch.freq_hz.size * stretch.step_s - seconds - margin)
        first, last = (int(t / stretch.step_s) for t in (start_s - margin, start_s + seconds))
        if np.isfinite(stretch.freq_hz[first : last + 30]).all():
            return float(start_s)
