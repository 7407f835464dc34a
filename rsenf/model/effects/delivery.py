"""Effects on delivery: frames lost, doubled or converted to another rate, jitter of time stamps.

Events fall on certain frames, either drawn or given; a search finds them where the flicker's phase
jumps for good.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.model.effects.base import DeliveryEffect, Run
from rsenf.model.effects.search import Hiding, ResidualFeatures, Weakest
from rsenf.model.parameters import parameter
from rsenf.model.shutter import Clip, Int64Array

LEAST_LEAP_RAD = 0.2  # smaller jumps can't be told from noise
MOST_RATIO = 0.05  # of the frames; more jumps mean that the model doesn't fit at all
MOST_AT_ONCE = 3


def event_frames(per_min: float, at_frames: tuple[int, ...], run: Run) -> Int64Array:
    """Captured frames at which events occur, rising; never frame 0.

    Parameters
    ----------
    per_min : float
        Mean rate of events, which are equally likely in all frames.
    at_frames : tuple of int
        If any, exactly these frames, as far as the clip reaches.
    run : Run
        Of the effect.
    """
    if at_frames:
        frames = np.unique(np.array(at_frames, np.int64))
        return frames[(frames > 0) & (frames < run.frames)]
    chance = min(per_min * run.step_s / 60, 1.0)
    if not chance:
        return np.empty(0, np.int64)
    rng, numbers, last = run.rng(), [], 0
    while (last := last + int(rng.geometric(chance))) < run.frames:
        numbers.append(last)
    return np.array(numbers, np.int64)


def leaps(features: ResidualFeatures, turns: float) -> NDArray[np.int64]:
    """Frames at which the flicker's phase jumps ahead by a given amount, for good.

    Parameters
    ----------
    features : ResidualFeatures
    turns : float
        Size of the jump in periods, modulo 1.
    """
    step = 2.0 * np.pi * (turns - np.rint(turns))
    if abs(step) < LEAST_LEAP_RAD:
        return np.empty(0, np.int64)
    moved = np.diff(features.angle_rad, prepend=features.angle_rad[0])
    moved = np.angle(np.exp(1j * moved))
    near = np.abs(np.angle(np.exp(1j * (moved - step)))) < abs(step) / 4
    found = np.flatnonzero(near)
    return found if found.size < MOST_RATIO * near.size else np.empty(0, np.int64)


@dataclass(frozen=True, kw_only=True)
class FrameDrop(DeliveryEffect):
    """Now and then a captured frame is not delivered.

    If the time stamps don't show the loss, the phase of the flicker's alias jumps ahead at each
    loss by the light's phase in a frame period, ``2π·f_0/F_r``, and the clip ends early. Otherwise
    the stamps have a gap, and nothing else shows.
    """

    name = "frame_drop"
    source = "network cameras, FFmpeg's fps and select filters (Stamm et al., IEEE TIFS 7, 2012)"
    confused_with = ("frame_duplicate", "clock_skew")
    told_apart_by = (
        "the sign of the phase step; where the alias is at 0 Hz (25 fps at 50 Hz) there is none, "
        "and only motion in the scene or a second clock tells"
    )
    weakest = Weakest(1.0)  # a minute
    never_with = ("frame_duplicate",)

    drops_per_min: float = parameter(1.0, "frames lost per minute, on average", low=0, high=600)
    at_frames: tuple[int, ...] = parameter(
        (), "exactly these captured frames instead", low=1, high=1e9
    )
    retimed: bool = parameter(True, "stamps run on as if nothing was lost; else they leave a hole")

    def apply(self, clip: Clip, run: Run) -> None:
        """Remove the frames from those delivered."""
        lost = event_frames(self.drops_per_min, self.at_frames, run)
        kept = ~np.isin(clip.number, lost)
        before = np.cumsum(~kept)[kept]
        clip.number, clip.slot = clip.number[kept], clip.slot[kept]
        if clip.blend is not None:
            clip.blend = clip.blend[kept]
        if self.retimed:
            clip.slot = clip.slot - before

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """Frames at which the phase of the flicker jumps ahead by one or a few frame periods."""
        lost: dict[int, int] = {}
        for many in range(MOST_AT_ONCE, 0, -1):  # of several that match, the fewest
            lost |= dict.fromkeys(leaps(features, many * features.turns_per_frame).tolist(), many)
        numbers: list[int] = []
        for frame in sorted(lost):
            # Each frame lost before shifts the numbers of captured frames by one.
            numbers += [frame + len(numbers) + k for k in range(lost[frame])]
        return [{"at_frames": tuple(numbers)}] if numbers else []

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the frames."""
        return {"at_frames": hiding.events(hiding.times * cls.weakest.change)}


@dataclass(frozen=True, kw_only=True)
class FrameDuplicate(DeliveryEffect):
    """Now and then a frame is delivered twice, the second time in the place of a later one.

    Both are identical to the last bit (before an encoder). If all later frames move on by a slot to
    make room, the phase of the flicker's alias jumps back by ``2π·f_0/F_r``; if the copy replaces
    the next frame, the phase stands still for one frame and then goes on.
    """

    name = "frame_duplicate"
    source = "constant frame rates, FFmpeg's fps filter (Wang and Farid, ACM MM&Sec, 2007)"
    confused_with = ("frame_drop", "clock_skew")
    told_apart_by = "the sign of the phase step; two equal frames side by side"
    weakest = Weakest(1.0)  # a minute

    duplicates_per_min: float = parameter(
        1.0, "frames repeated per minute, on average", low=0, high=600
    )
    at_frames: tuple[int, ...] = parameter(
        (), "exactly these captured frames instead", low=1, high=1e9
    )
    retimed: bool = parameter(
        True, "later frames move on by a slot; else the copy hides the next frame"
    )

    def apply(self, clip: Clip, run: Run) -> None:
        """Deliver the frames twice."""
        twice = np.isin(clip.number, event_frames(self.duplicates_per_min, self.at_frames, run))
        if self.retimed:
            source = np.repeat(np.arange(twice.size), 1 + twice)
            again = np.diff(source, prepend=-1) == 0
            clip.slot = (clip.slot + np.cumsum(twice) - twice)[source] + again
            clip.number = clip.number[source]
            clip.blend = None if clip.blend is None else clip.blend[source]
        else:
            hidden = np.flatnonzero(twice[:-1]) + 1
            clip.number = clip.number.copy()
            clip.number[hidden] = clip.number[hidden - 1]
            if clip.blend is not None:
                clip.blend[hidden] = clip.blend[hidden - 1]

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """Frames at which the phase of the flicker falls back by one frame period.

        If the phase makes up for it one frame later, the copy has replaced a frame.
        """
        back = leaps(features, -features.turns_per_frame)
        hides = np.isin(back + 1, leaps(features, features.turns_per_frame))
        moved = tuple(int(n) - 1 - k for k, n in enumerate(back[~hides]))
        hiding = tuple(int(n) - 1 for n in back[hides])
        tries = [{"at_frames": moved, "retimed": True}, {"at_frames": hiding, "retimed": False}]
        return [values for values in tries if values["at_frames"]]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the frames."""
        return {"at_frames": hiding.events(hiding.times * cls.weakest.change)}


@dataclass(frozen=True, kw_only=True)
class RateConversion(DeliveryEffect):
    """Frames are dropped, duplicated or blended to another frame rate; time stamps are regular.

    With whole frames, number ``m`` of ``R`` a second is frame ``⌈(m + ½)·F_r/R⌉ − 1``, and the
    phase of the flicker's alias jumps by the light's phase in a frame period wherever one is
    dropped or duplicated, at the beat of the two rates. With blending, each frame is the weighted
    mean of the two around ``m·F_r/R``, whose flicker has the phase of the mean of two tones and is
    weaker in between.
    """

    name = "rate_conversion"
    source = "FFmpeg's fps and framerate filters (Poynton, Digital Video and HD, 2012)"
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


@dataclass(frozen=True, kw_only=True)
class TimestampJitter(DeliveryEffect):
    """Frames are captured regularly, but their time stamps are early or late at random.

    Stamp ``n`` is ``t_n + ε_n``: by the stamps, the phase of the flicker has a jitter of
    ``2π·f_0·ε_n``; by the frame numbers it has none. Errors are less than half a frame period, so
    that stamps never run backwards.
    """

    name = "timestamp_jitter"
    source = "RTP arrival stamps (RFC 3550), software stamping; 0.1 to 5 ms"
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
