"""A clip to be laid beside a reference: its estimates, and how theories are filmed alike."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from rsenf.discrepancy.estimates import enf_of
from rsenf.discrepancy.measured import Float32Array, Measured, frame_rate_of, joined_rows
from rsenf.errors import InputError
from rsenf.messages import EnfEstimate, RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel, GridPath, simulate_rows
from rsenf.track import TrackSettings

# From the stamps and row means (frames, lines, strips) of a film to estimates.
Tracker = Callable[[FloatArray, Float32Array], Sequence[EnfEstimate]]

SEED = 0
FEW_LINES = 16  # do for a film of which only each frame's mean is looked at
DITHER_LEVEL = 0.01  # of a row: without any noise a tracker takes what it can't model for noise
FRAME_MEANS = "frame"  # for an axis of the read-out


@dataclass(frozen=True, eq=False)
class Clip:
    """What is known of a clip's ENF, and how to film what a model says of it.

    Attributes
    ----------
    estimates : sequence of EnfEstimate
    track : callable
        The tracker that made them.
    frame_rate : Fraction
    duration_s : float
        By the camera's clock, to the end of the last frame.
    frame_means : bool
        Whether there was one mean for each frame.
    """

    estimates: Sequence[EnfEstimate]
    track: Tracker
    frame_rate: Fraction
    duration_s: float
    frame_means: bool

    def film(
        self, model: CaptureModel, grid: GridPath, noise_ratio: float = 0.0
    ) -> list[EnfEstimate]:
        """Film and track, with hardly any noise; frame means with so much of the flicker's size."""
        shutter = dataclasses.replace(model.shutter, frame_rate=self.frame_rate)
        if self.frame_means:
            shutter = dataclasses.replace(shutter, rows=FEW_LINES, columns=FEW_LINES)
        model = dataclasses.replace(model, shutter=shutter)
        made = simulate_rows(model, grid, self.duration_s, SEED, noise=False)
        level, noise_level = made.level, DITHER_LEVEL
        if self.frame_means:
            level = level.mean(axis=1, keepdims=True)
            noise_level = noise_ratio * float(level.std())
        noise = np.random.default_rng(SEED).standard_normal(level.shape, np.float32)
        level = level + np.float32(noise_level) * noise
        return list(self.track(made.frame_time_s, level))


def clip_of(data: Measured) -> Clip:
    """Return what rows tell of their ENF."""
    rate = float(data.frame_rate)

    def track(stamp_s: FloatArray, level: Float32Array) -> Sequence[EnfEstimate]:
        # As of the data: frames count, their stamps may jitter.
        slot = np.rint((stamp_s - stamp_s[0]) * rate)
        return enf_of(level, slot / rate, data.axis, TrackSettings(nominal_hz=data.nominal_hz))

    duration_s = float(data.time_s[-1]) + 1.0 / rate
    return Clip(data.estimates.enf, track, data.frame_rate, duration_s, frame_means=False)


def clip_of_frame_means(blocks: Sequence[RowBlock], nominal_hz: float) -> Clip:
    """Return what one mean a frame tells of the ENF.

    Parameters
    ----------
    blocks : sequence of RowBlock
        Of one epoch, in order.
    nominal_hz : float
        50 or 60.

    Raises
    ------
    InputError
        When there are too few, or they hold nothing that changes.
    """
    level, stamp_s = joined_rows(blocks)
    if stamp_s.size < 2:
        raise InputError("a single frame", "give a recording of mains light")
    settings = TrackSettings(method="frame_mean", nominal_hz=nominal_hz)

    def track(times_s: FloatArray, level: Float32Array) -> Sequence[EnfEstimate]:
        return enf_of(level, times_s, FRAME_MEANS, settings)

    rate = frame_rate_of(stamp_s)
    duration_s = float(stamp_s[-1]) + 1.0 / float(rate)
    return Clip(track(stamp_s, level), track, rate, duration_s, frame_means=True)


def holds_frame_means(blocks: Sequence[RowBlock]) -> bool:
    """Whether there is one mean for each frame, and no rows."""
    return bool(blocks) and blocks[0].read_out_axis == FRAME_MEANS
