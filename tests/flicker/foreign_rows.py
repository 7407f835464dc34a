"""Rows of the foreign camera through the follower, beside the truth."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.follower import FlickerFollower
from rsenf.flicker.second import FlickerSecond
from rsenf.messages import Header
from rsenf.rows.stage import blocks_from_luminance
from tests.discrepancy.foreign_camera import Case, film
from tests.discrepancy.foreign_camera.cases import plan_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Followed:
    """What is said of a film, and what is true.

    Attributes
    ----------
    seconds : list of FlickerSecond
    hidden : dict
        What the film hides, and with which parameters.
    off_hz, z : ndarray
        Errors of the grid's frequency in the usable seconds, and those over the stated ones.
    """

    seconds: list[FlickerSecond]
    hidden: dict[str, Any]
    off_hz: Array
    z: Array

    @property
    def slips(self) -> list[tuple[int, int]]:
        """Frames, and how many are said to be lost before each; negative for shown again."""
        return sorted((s.frame_number, s.frames) for sec in self.seconds for s in sec.slips)

    @property
    def true_slips(self) -> list[tuple[int, int]]:
        """Those that there are."""
        lost = self.hidden.get("frame_drop", {"at_frames": [], "frames_lost": []})
        again = self.hidden.get("frame_duplicate", {"at_frames": [], "form": ""})
        true = list(zip(lost["at_frames"], lost["frames_lost"], strict=True))
        true += [(at, -1) for at in again["at_frames"]]
        if again["form"] == "in place":
            true += [(at + 1, 1) for at in again["at_frames"]]
        return sorted(true)

    @property
    def converted(self) -> bool:
        """Whether the film is said to be converted."""
        return any(s.converted for s in self.seconds)

    @property
    def rms_z(self) -> float:
        """Of all usable seconds."""
        return float(np.sqrt(np.mean(self.z**2))) if self.z.size else 0.0


def follow(case: Case, *, bridged: bool = False, unit_s: float = 0.0) -> Followed:
    """Film a case and follow its flicker.

    Parameters
    ----------
    case : Case
    bridged : bool
        Whether seconds are compared with those that passed, lost frames and all, instead of those
        by the time stamps.
    unit_s : float
        To which a container rounds the stamps; 0 for none.
    """
    filmed = film(case)
    follower = FlickerFollower()
    stamp_s = unit_s * np.rint(filmed.stamp_s / unit_s) if unit_s else filmed.stamp_s
    blocks = blocks_from_luminance(filmed.level, stamp_s, Header(source="t/c"))
    seconds = [*itertools.chain.from_iterable(map(follower.update, blocks)), *follower.flush()]
    usable = [s for s in seconds if s.usable]
    at_s = np.array([s.start_s for s in usable])
    if bridged:
        plan, _ = plan_of(case)
        begin_s = plan.begin_s + at_s
        true_hz = plan.grid.turns(begin_s + 1.0) - plan.grid.turns(begin_s)
    else:
        true_hz = filmed.mean_hz(at_s, at_s + 1.0)
    off_hz = np.array([s.f0_hz for s in usable]) / 2.0 - true_hz
    std_hz = np.sqrt([s.f0_var_hz2 for s in usable]) / 2.0
    return Followed(seconds, filmed.hidden, off_hz, off_hz / std_hz)
