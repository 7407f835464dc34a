"""Effects of an encoder on the flicker: loss in a group of pictures (GOP), temporal low-pass."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import CodecEffect, Run
from rsenf.model.effects.search import Hiding, ResidualFeatures, Weakest
from rsenf.model.grid import FloatArray
from rsenf.model.line_light import LineLight
from rsenf.model.noise import Float32Array
from rsenf.model.parameters import Fitting, parameter

SAWTOOTH_CORRELATION = 0.97  # of a course that counts as one, at least
LONGEST, FOLDS = 300, 4  # longest period in frames; least number of periods
PERIOD_STANDS_OUT = 8.0  # standard deviations of the F statistic
LONGER = 1.1  # factor by which a longer period must do better
FIRST_STANDS_OUT = 8.0  # robust standard deviations of the frames' flicker


@dataclass(frozen=True, kw_only=True)
class GopAttenuation(CodecEffect):
    """After each key frame the encoder loses more of the flicker, until the next one restores it.

    The amplitude of the flicker is a sawtooth in time, ``1 − loss·age/(period − 1)``: every line of
    the flicker has sidebands at multiples of the key frames' rate, and the mean level has none.
    """

    name = "gop_attenuation"
    source = "ITU-T H.264 and H.265: groups of pictures of 12 to 300 frames"
    confused_with = ("codec_lowpass", "interharmonic")
    told_apart_by = "the period, which the container's key frames tell"
    any_course = True
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
        """Attenuate the flicker, more with each frame since the last key frame."""
        first = run.memory.get("delivered", self.first_age)
        run.memory["delivered"] = first + len(light.level)
        age = (first + np.arange(len(light.level))) % self.period_frames
        even = np.arange(self.period_frames) / (self.period_frames - 1)
        loss = np.resize(self.profile, self.period_frames) if self.profile else even
        light.scale_flicker(1 - self.loss_ratio * loss[age, None])

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """The period at which the flicker's amplitude repeats best, and its divisors.

        For each, the key frames at which a sawtooth fits the amplitude best; and the amplitude's
        own course.
        """
        size = features.size_ratio - features.size_ratio.mean()
        spectrum = np.abs(np.fft.rfft(size, 2 * size.size)) ** 2
        again = np.fft.irfft(spectrum)[: size.size // 4]
        best = 2 + int(np.argmax(again[2:] / (size.size - np.arange(2, again.size))))
        periods = [n for n in range(2, best + 1) if best % n == 0]
        even = [{"period_frames": n, "first_age": _first_age(size, n)} for n in periods]
        return [*even, *_folded_course(size)]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the period, too."""
        period = int(hiding.rng.choice([12, 15, 24, 25, 30, 48, 50, 60]))
        return {**super().hidden(hiding), "period_frames": period}


def _first_age(size: FloatArray, period: int) -> int:
    """Age of the first frame at which an amplitude that falls between key frames fits best."""
    folded = size[: size.size // period * period].reshape(-1, period).mean(axis=0)
    ages = (np.arange(period)[:, None] + np.arange(period)) % period
    return int(np.argmin(ages @ folded))


def _is_even(course: FloatArray) -> bool:
    """Whether an amplitude falls linearly within the period, as a sawtooth does."""
    saw = np.arange(course.size) - (course.size - 1) / 2.0
    along = max(-float(np.roll(course, n) @ saw) for n in range(course.size))
    return along > SAWTOOTH_CORRELATION * float(np.linalg.norm(course) * np.linalg.norm(saw))


def _folded_course(size: FloatArray) -> list[dict[str, Any]]:
    """Period and course of an amplitude, by folding it; the most significant period."""
    best, sure, chosen = 0.0, PERIOD_STANDS_OUT, np.empty(0)
    for period in range(2, min(LONGEST, size.size // FOLDS) + 1):
        folds = size[: size.size // period * period].reshape(-1, period)
        course = folds.mean(axis=0)
        within = (folds - course).var(axis=0, ddof=1).mean() / len(folds)
        # F statistic of the folded course, less its expectation, over its standard deviation.
        above = (float((course**2).mean() / within) - 1.0) * math.sqrt(period / 2.0)
        if above > max(best * LONGER, sure):
            best, chosen = above, course
    if not chosen.size or _is_even(chosen):
        return []
    most = float(np.abs(chosen - chosen.max()).max())
    profile = (chosen.max() - chosen) / most
    return [{"period_frames": chosen.size, "profile": tuple(profile.tolist())}]


@dataclass(frozen=True, kw_only=True)
class CodecLowpass(CodecEffect):
    """Predicted frames take over only a share of each change: ``y += gain · (x − y)``.

    The flicker passes a first-order low-pass at its alias frequency ``f``: with
    ``z = exp(2πj·f/F_r)`` the transfer function is ``gain / (1 − (1 − gain)/z)``. An alias at 0 Hz
    passes unchanged, one near half the frame rate hardly passes.
    """

    name = "codec_lowpass"
    source = "ITU-T H.264, predicted frames: measured on x264 at 50 to 150 kbit/s, to first order"
    confused_with = ("flicker_ratio", "gop_attenuation", "exposure")
    told_apart_by = (
        "harmonics, whose aliases are elsewhere, lose other shares; the first frames after a key "
        "frame, which still have all of the flicker"
    )
    not_hidden = "but for the first frames it is a weaker flicker, which is fitted anyway"

    gain: float = parameter(
        0.3, "share of a change that a frame takes over", low=0.001, high=1,
        fitting=Fitting(None, -0.02),
    )  # fmt: skip

    def apply(self, light: LineLight, run: Run) -> None:
        """Apply the recursion to successive delivered frames, line by line."""
        light.level = self._follow(light.level, "level", run)
        if light.slope is not None:
            light.slope = self._follow(light.slope, "slope", run)

    def _follow(self, wanted: Float32Array, what: str, run: Run) -> Float32Array:
        gain, out = np.float32(self.gain), np.empty_like(wanted)
        for n, frame in enumerate(wanted):
            held = run.memory.get(what, frame)
            out[n] = run.memory[what] = held + gain * (frame - held)
        return out

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """Gain from the amplitude of the flicker relative to that in the first frame, a key frame.

        If the clip doesn't begin with a key frame, an attenuated pure tone is just a weaker tone.
        """
        size = features.size_ratio
        usual = float(np.median(size))
        spread = 1.4826 * float(np.median(np.abs(size - usual)))
        if size[0] < usual + FIRST_STANDS_OUT * spread:
            return []
        gain = np.linspace(0.01, 0.99, 99)
        turn = np.exp(-2j * np.pi * features.turns_per_frame)
        kept = gain / np.abs(1.0 - (1.0 - gain) * turn)
        return [{"gain": float(gain[np.argmin(np.abs(kept - usual / size[0]))])}]
