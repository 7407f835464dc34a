"""Clips with phases, of known place and errors, for the phase matcher's tests."""

from __future__ import annotations

import dataclasses

import numpy as np

from rsenf.bench.calibration.searches import DrawnClip, measured_reference, track_of_clip
from rsenf.match.series import Grid
from rsenf.model import synthetic_grid

CLEAN = DrawnClip(
    start_s=0.0,
    seconds=120,
    noise_rad=0.01,
    claimed_ratio=1.0,
    wander_rad=0.0,
    wander_s=5.0,
    hole_ratio=0.0,
    clock_ppm=0.0,
    reference_hz=3e-4,
)


def stretch_of(seconds, seed, *, step_s=1.0, nominal_hz=50.0, name="made"):
    """A grid's frequency: means over steps of a path drawn from a seed."""
    path = synthetic_grid(seed, seconds + 2.0, nominal_hz=nominal_hz)
    cycles = path.cycles(np.arange(round(seconds / step_s) + 1) * step_s)
    return Grid(name, nominal_hz, 0, step_s, np.diff(cycles) / step_s)


def hidden(stretch, seed, **properties):
    """A clip's track and the reference that somebody else measured."""
    rng = np.random.default_rng(seed)
    drawn = dataclasses.replace(CLEAN, **properties)
    track = track_of_clip(stretch, drawn, rng)
    return track, measured_reference(stretch, drawn, rng)
