"""Flicker that fades from one key frame to the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import CodecEffect, Run
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.effects.residue import Residue
from rsenf.model.grid import FloatArray
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter


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

    def apply(self, light: LineLight, run: Run) -> None:
        """Draw the light towards its mean, more with each frame since the last key frame."""
        first = run.memory.get("delivered", self.first_age)
        run.memory["delivered"] = first + len(light.level)
        age = (first + np.arange(len(light.level))) % self.period_frames
        keep = (1 - self.loss_ratio * age / (self.period_frames - 1)).astype(np.float32)[:, None]
        light.level = 1 + keep * (light.level - 1)
        if light.slope is not None:
            light.slope = keep * light.slope

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """Try the period at which the flicker's size repeats best, and what divides it.

        Of each, with key frames where the sawtooth fits the size best.
        """
        size = residue.size_ratio - residue.size_ratio.mean()
        spectrum = np.abs(np.fft.rfft(size, 2 * size.size)) ** 2
        again = np.fft.irfft(spectrum)[: size.size // 4]
        best = 2 + int(np.argmax(again[2:] / (size.size - np.arange(2, again.size))))
        periods = [n for n in range(2, best + 1) if best % n == 0]
        return [{"period_frames": n, "first_age": _first_age(size, n)} for n in periods]

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
