"""Dropped frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.clip import Clip
from rsenf.model.effects.base import DeliveryEffect, Run
from rsenf.model.effects.events import event_frames, leaps
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.effects.residue import Residue
from rsenf.model.parameters import parameter

MOST_AT_ONCE = 3


@dataclass(frozen=True, kw_only=True)
class FrameDrop(DeliveryEffect):
    """Now and then a captured frame is not delivered.

    If the time stamps don't show the loss, the phase of the flicker's alias jumps ahead at each
    loss by the light's phase in a frame period, ``2π·f_0/F_r``, and the clip ends early. Otherwise
    the stamps have a gap, and nothing else shows.
    """

    name = "frame_drop"
    source = "network cameras, overloaded recorders; FFmpeg's fps and select filters"
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
        if self.retimed:
            clip.slot = clip.slot - before

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """Frames at which the phase of the flicker jumps ahead by one or a few frame periods."""
        lost: dict[int, int] = {}
        for many in range(MOST_AT_ONCE, 0, -1):  # of several that match, the fewest
            lost |= dict.fromkeys(leaps(residue, many * residue.turns_per_frame).tolist(), many)
        numbers: list[int] = []
        for frame in sorted(lost):
            # Each frame lost before shifts the numbers of captured frames by one.
            numbers += [frame + len(numbers) + k for k in range(lost[frame])]
        return [{"at_frames": tuple(numbers)}] if numbers else []

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the frames."""
        return {"at_frames": hiding.events(hiding.times * cls.weakest.change)}
