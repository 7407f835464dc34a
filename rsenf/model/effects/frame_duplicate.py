"""Duplicated frames."""

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


@dataclass(frozen=True, kw_only=True)
class FrameDuplicate(DeliveryEffect):
    """Now and then a frame is delivered twice, the second time in the place of a later one.

    Both are identical to the last bit (before an encoder). If all later frames move on by a slot to
    make room, the phase of the flicker's alias jumps back by ``2π·f_0/F_r``; if the copy replaces
    the next frame, the phase stands still for one frame and then goes on.
    """

    name = "frame_duplicate"
    source = "conversion to a constant frame rate; FFmpeg's fps filter"
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
        else:
            hidden = np.flatnonzero(twice[:-1]) + 1
            clip.number = clip.number.copy()
            clip.number[hidden] = clip.number[hidden - 1]

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """Frames at which the phase of the flicker falls back by one frame period.

        If the phase makes up for it one frame later, the copy has replaced a frame.
        """
        back = leaps(residue, -residue.turns_per_frame)
        hides = np.isin(back + 1, leaps(residue, residue.turns_per_frame))
        moved = tuple(int(n) - 1 - k for k, n in enumerate(back[~hides]))
        hiding = tuple(int(n) - 1 for n in back[hides])
        tries = [{"at_frames": moved, "retimed": True}, {"at_frames": hiding, "retimed": False}]
        return [values for values in tries if values["at_frames"]]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the frames."""
        return {"at_frames": hiding.events(hiding.times * cls.weakest.change)}
