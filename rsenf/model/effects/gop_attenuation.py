"""Flicker that fades from one key frame to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import CodecEffect, Run
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.effects.residue import Residue
from rsenf.model.grid import FloatArray
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter

EVEN = 0.97  # correlation with a sawtooth, from which on a course is one
LONGEST, FOLDS = 300, 4  # frames of a group, and how many groups there must be
STANDS_OUT, LONGER = 8.0, 1.1  # standard errors; and over those of a period that divides it


@dataclass(frozen=True, kw_only=True)
class GopAttenuation(CodecEffect):
    """After each key frame a little more of the flicker is lost, until the next brings it back.

    The flicker's size is a sawtooth in time: side lines at multiples of the key frames' rate about
    every line of the flicker, none at the direct current.
    """

    name = "gop_attenuation"
    source = "H.264 and H.265 groups of pictures of 12 to 300 frames"
    confused_with = ("codec_lowpass", "interharmonic")
    told_apart_by = "the period, which the container's key frames tell"
    weakest = Weakest(0.01, "loss_ratio")

    loss_ratio: float = parameter(
        0.05, "share of the flicker lost at the end of a group", low=0, high=1,
        fitting=Fitting(0.0, 0.02),
    )  # fmt: skip
    period_frames: int = parameter(30, "frames from key frame to key frame", low=2, high=3000)
    first_age: int = parameter(0, "frames from a key frame to the first", low=0, high=2999)
    profile: tuple[float, ...] = parameter(
        (), "loss at each age, over that at the end; none grows evenly", low=-10, high=10
    )

    def apply(self, light: LineLight, run: Run) -> None:
        """Draw the light towards its mean, more with each frame since the last key frame."""
        first = run.memory.get("delivered", self.first_age)
        run.memory["delivered"] = first + len(light.level)
        age = (first + np.arange(len(light.level))) % self.period_frames
        even = np.arange(self.period_frames) / (self.period_frames - 1)
        loss = np.resize(self.profile, self.period_frames) if self.profile else even
        keep = (1 - self.loss_ratio * loss[age]).astype(np.float32)[:, None]
        light.level = 1 + keep * (light.level - 1)
        if light.slope is not None:
            light.slope = keep * light.slope

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """Try the period with which the flicker's size repeats best, and what divides it.

        Of each, with key frames where the sawtooth fits the size best, and with the course that
        the size itself has.
        """
        size = residue.size_ratio - residue.size_ratio.mean()
        spectrum = np.abs(np.fft.rfft(size, 2 * size.size)) ** 2
        again = np.fft.irfft(spectrum)[: size.size // 4]
        best = 2 + int(np.argmax(again[2:] / (size.size - np.arange(2, again.size))))
        periods = [n for n in range(2, best + 1) if best % n == 0]
        even = [{"period_frames": n, "first_age": _first_age(size, n)} for n in periods]
        return [*even, *_own_course(size)]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the period, too."""
        period = int(hiding.rng.choice([12, 15, 24, 25, 30, 48, 50, 60]))
        return {**super().hidden(hiding), "period_frames": period}


def _first_age(size: FloatArray, period: int) -> int:
    """Age of the first frame with which a size that falls from key frame to key frame fits best."""
    folded = size[: size.size // period * period].reshape(-1, period).mean(axis=0)
    ages = (np.arange(period)[:, None] + np.arange(period)) % period
    return int(np.argmin(ages @ folded))


def _is_even(course: FloatArray) -> bool:
    """Whether a size falls evenly from some frame to the next such frame, as a sawtooth does."""
    saw = np.arange(course.size) - (course.size - 1) / 2.0
    along = max(-float(np.roll(course, n) @ saw) for n in range(course.size))
    return along > EVEN * float(np.linalg.norm(course) * np.linalg.norm(saw))


def _own_course(size: FloatArray) -> list[dict[str, Any]]:
    """Guess the period and the course of a size by folding it: that which stands out most."""
    best, sure, chosen = 0.0, STANDS_OUT, np.empty(0)
    for period in range(2, min(LONGEST, size.size // FOLDS) + 1):
        folds = size[: size.size // period * period].reshape(-1, period)
        course = folds.mean(axis=0)
        within = (folds - course).var(axis=0, ddof=1).mean() / len(folds)
        # Its mean square, less what chance makes of it, over the error of that (F statistic).
        above = (float((course**2).mean() / within) - 1.0) * math.sqrt(period / 2.0)
        if above > max(best * LONGER, sure):
            best, chosen = above, course
    if not chosen.size or _is_even(chosen):
        return []
    most = float(np.abs(chosen - chosen.max()).max())
    profile = (chosen.max() - chosen) / most
    return [{"period_frames": chosen.size, "profile": tuple(profile.tolist())}]
