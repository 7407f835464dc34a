"""Jitter of time stamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.model.clip import Clip
from rsenf.model.effects.base import DeliveryEffect, Run
from rsenf.model.effects.hiding import Weakest
from rsenf.model.parameters import parameter


@dataclass(frozen=True, kw_only=True)
class TimestampJitter(DeliveryEffect):
    """Frames are captured regularly, but their time stamps are early or late at random.

    By the stamps, the phase of the flicker has a jitter of ``2π·f_0`` times their error; by the
    frame numbers it has none. Errors are less than half a frame period, so that stamps never run
    backwards.
    """

    name = "timestamp_jitter"
    source = "RTP arrival stamps, software stamping; 0.1 to 5 ms"
    confused_with = ("capture_jitter", "image_wobble")
    told_apart_by = "the stamps themselves against the flicker's phase: the jitter is in both"
    weakest = Weakest(1e-4, "jitter_s")

    jitter_s: float = parameter(1e-3, "rms", low=0, high=0.02)
    error_s: tuple[float, ...] = parameter(
        (), "exactly these errors instead, one a frame", low=-1, high=1
    )

    def apply(self, clip: Clip, run: Run) -> None:
        """Shift the time stamps."""
        if self.error_s:
            clip.stamp_offset_s += run.given(self.error_s)
            return
        error_s = self.jitter_s * run.rng().standard_normal(run.frames)
        error_s[0] = 0  # the clip's time begins with its first stamp
        most_s = 0.45 * run.step_s
        clip.stamp_offset_s += np.clip(error_s, -most_s, most_s)
