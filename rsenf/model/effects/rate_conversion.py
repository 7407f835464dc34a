"""Conversion of the frame rate."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from rsenf.model.clip import Clip, Int64Array
from rsenf.model.effects.base import DeliveryEffect, Run
from rsenf.model.parameters import parameter


@dataclass(frozen=True, kw_only=True)
class RateConversion(DeliveryEffect):
    """Frames are dropped, duplicated or blended to another frame rate; time stamps are regular.

    With whole frames, the phase of the flicker's alias jumps by the light's phase in a frame period
    wherever one is dropped or duplicated, at the beat of the two rates. With blending, each frame
    is a weighted mean of two, whose flicker has the phase of the mean of two tones and is weaker in
    between.
    """

    name = "rate_conversion"
    source = "FFmpeg's fps and framerate filters, video editors, standards converters"
    confused_with = ("frame_drop", "frame_duplicate", "clock_skew")
    told_apart_by = "the beat at which the phase leaps; equal frames side by side"
    not_hidden = "no course can be followed through its leaps: tracking undoes it, a fit doesn't"
    never_with = ("frame_drop", "frame_duplicate")

    to_rate: Fraction = parameter(Fraction(25), "frames a second that come out", low=1, high=1000)
    way: str = parameter(
        "whole",
        "the last frame whose time rounds to it; or two blended",
        choices=("whole", "blend"),
    )

    def apply(self, clip: Clip, run: Run) -> None:
        """Select, for each output frame, the input at its time."""
        step = clip.frame_rate / self.to_rate
        count = int(clip.slot[-1] / step) + 1
        out = np.arange(count)
        if self.way == "whole":  # halves are rounded up, as in FFmpeg's fps filter
            slot = _ceiling((2 * out + 1) * step.numerator, 2 * step.denominator) - 1
        else:
            slot = _ceiling(out * step.numerator, step.denominator)
            clip.blend = slot - out * float(step)
        taken = np.searchsorted(clip.slot, np.minimum(slot, clip.slot[-1]), "right") - 1
        clip.number, clip.slot = clip.number[taken], out
        clip.stamp_offset_s = np.zeros_like(clip.stamp_offset_s)
        clip.frame_rate = self.to_rate


def _ceiling(over: Int64Array, under: int) -> Int64Array:
    """Return the quotient of integers, rounded up."""
    return -(-over // under)
