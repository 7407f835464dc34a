"""A clip to be compared with a reference: its ENF estimates, and the simulation of a model's."""

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

# From time stamps (frames,) and row means (frames, lines, strips) to estimates.
Tracker = Callable[[FloatArray, Float32Array], Sequence[EnfEstimate]]

SEED = 0
FEW_LINES = 16  # enough for a simulation of frame means
DITHER_LEVEL = 0.01  # noise of a row (levels): without any, the tracker takes misfit for noise
FRAME_MEANS = "frame"  # in place of the read-out axis


@dataclass(frozen=True, eq=False)
class Clip:
    """A clip's ENF estimates, and what the simulation of a model needs.

    Attributes
    ----------
    estimates : sequence of EnfEstimate
    track : callable
        The tracker that made them.
    frame_rate : Fraction
    duration_s : float
        To the end of the last frame, by the camera's clock.
    frame_means : bool
        Whether the data are frame means.
    """

    estimates: Sequence[EnfEstimate]
    track: Tracker
    frame_rate: Fraction
    duration_s: float
    frame_means: bool

    def film(
        self, model: CaptureModel, grid: GridPath, noise_ratio: float = 0.0
    ) -> list[EnfEstimate]:
        """Simulate a model and track its ENF, with hardly any noise.

        Parameters
        ----------
        model : CaptureModel
        grid : GridPath
        noise_ratio : float, optional
            For frame means, the noise over the rms of the flicker.
        """
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
    """Return the clip of measured rows."""
    rate = float(data.frame_rate)

    def track(stamp_s: FloatArray, level: Float32Array) -> Sequence[EnfEstimate]:
        # As for the data: by frame number, since time stamps may jitter.
        slot = np.rint((stamp_s - stamp_s[0]) * rate)
        return enf_of(level, slot / rate, data.axis, TrackSettings(nominal_hz=data.nominal_hz))

    duration_s = float(data.time_s[-1]) + 1.0 / rate
    return Clip(data.estimates.enf, track, data.frame_rate, duration_s, frame_means=False)


def clip_of_frame_means(blocks: Sequence[RowBlock], nominal_hz: float) -> Clip:
    """Return the clip of frame means.

    Parameters
    ----------
    blocks : sequence of RowBlock
        Of one epoch, in order.
    nominal_hz : float
        50 or 60.

    Raises
    ------
    InputError
        When there are fewer than two frames, or a level isn't finite.
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
    """Whether blocks hold frame means instead of rows."""
    return bool(blocks) and blocks[0].read_out_axis == FRAME_MEANS
