"""The effects of the catalogue that can be hidden, and which of them go together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import in_level, in_light, in_time
from .plan import Plan

Hide = Callable[[Plan, float, np.random.Generator], dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Something that can be hidden.

    Attributes
    ----------
    listed : float
        Smallest strength that is to be named.
    help : str
        What it does, and what `listed` is measured in.
    hide : callable
        Puts it into a plan at a size, and returns its parameters as rows show them.
    none : float
        Size at which it does nothing.
    needs : str
        What an analyst needs besides row luminance and stamps, if anything: ``"strips"``
        (two or more) or ``"reference"`` (the grid's true frequency).
    """

    listed: float
    help: str
    hide: Hide
    none: float = 0.0
    needs: str = ""

    def size(self, times: float) -> float:
        """That many times the smallest strength."""
        return self.none + times * (self.listed - self.none)


EFFECTS: dict[str, Effect] = {
    "harmonics": Effect(
        listed=0.003,
        help="more second harmonic than the lamp has, relative to its first",
        hide=in_light.harmonics,
    ),
    "second_lamp": Effect(
        listed=0.02,
        help="share of the light, in some strips, that another mains phase feeds",
        hide=in_light.second_lamp,
        needs="strips",
    ),
    "pwm_tone": Effect(
        listed=5e-4, help="dimmer at 500 to 5000 Hz, amplitude to mean", hide=in_light.pwm_tone
    ),
    "interharmonic": Effect(
        listed=2e-4,
        help="a swing of the supply or a tone that is no multiple, amplitude to mean",
        hide=in_light.interharmonic,
    ),
    "frame_drop": Effect(listed=1.0, help="frames lost a minute", hide=in_time.frame_drop),
    "capture_jitter": Effect(
        listed=20e-6,
        help="frames begin early or late, which their stamps don't say; seconds rms",
        hide=in_time.capture_jitter,
    ),
    "readout_drift": Effect(
        listed=0.002,
        help="the read-out time drifts over the film, relative, rms about its mean",
        hide=in_time.readout_drift,
    ),
    "auto_exposure": Effect(
        listed=0.002,
        help="gain of frames, relative, rms about its mean",
        hide=in_level.auto_exposure,
    ),
    "row_banding": Effect(
        listed=0.003,
        help="pattern over rows that comes and goes, relative to level, rms about its mean",
        hide=in_level.row_banding,
    ),
}
