"""Jitter of the capture time of frames."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.model.clip import Clip
from rsenf.model.effects.base import FrameEffect, Run
from rsenf.model.effects.hiding import Weakest
from rsenf.model.parameters import Fitting, parameter


@dataclass(frozen=True, kw_only=True)
class CaptureJitter(FrameEffect):
    """Each frame begins early or late at random, unknown to its time stamp.

    All rows of a frame shift together: the phase of harmonic ``k`` has white jitter from frame to
    frame, ``k`` times that of the first.
    """

    name = "capture_jitter"
    source = "frame starts that software triggers; 1 to 500 µs"
    confused_with = ("timestamp_jitter", "image_wobble")
    told_apart_by = (
        "stamps that jitter along, and the texture of the scene: it stands still here, and moves "
        "with an image that wobbles"
    )
    weakest = Weakest(20e-6, "jitter_s")

    jitter_s: float = parameter(1e-4, "rms", low=0, high=5e-3)
    late_s: tuple[float, ...] = parameter(
        (), "exactly so late instead, one value a frame", low=-0.1, high=0.1,
        fitting=Fitting(0.0, 2e-5, each="frame", rms="jitter_s"),
    )  # fmt: skip

    def apply(self, clip: Clip, run: Run) -> None:
        """Shift the starts, by white noise or as given."""
        late_s = self.jitter_s * run.rng().standard_normal(run.frames)
        clip.start_s = clip.start_s + (run.given(self.late_s) if self.late_s else late_s)
