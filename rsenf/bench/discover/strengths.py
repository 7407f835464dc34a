"""The weakest of each effect that is to be named, of rows of 60 s; how strong ones are drawn."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

Draw = Callable[[np.random.Generator, float, int, Fraction, float], dict[str, Any]]

APART_HZ = 0.7  # a tone nearer to a multiple of the frame rate stands still in the picture
SEEN = 0.3  # of a tone, that the exposure must leave
FRAMES_APART = 40


def _single(name: str, weakest: float, neutral: float = 0.0) -> Draw:
    """An effect of one size."""

    def draw(
        rng: np.random.Generator, times: float, frames: int, rate: Fraction, exposure_s: float
    ) -> dict[str, Any]:
        return {name: neutral + times * weakest}

    return draw


def _harmonics(
    rng: np.random.Generator, times: float, frames: int, rate: Fraction, exposure_s: float
) -> dict[str, Any]:
    phase = float(rng.uniform(-math.pi, math.pi))
    return {"second_ratio": times * 0.003, "second_phase_rad": phase}


def _second_lamp(
    rng: np.random.Generator, times: float, frames: int, rate: Fraction, exposure_s: float
) -> dict[str, Any]:
    return {"weight": times * 0.02, "phase_rad": float(rng.choice([-1, 1])) * 2.0 * math.pi / 3.0}


def _events(
    rng: np.random.Generator, times: float, frames: int, rate: Fraction, exposure_s: float
) -> dict[str, Any]:
    """So many a minute, not at the ends, not close to each other."""
    count = max(round(times * frames / float(rate) / 60.0), 1)
    places = np.arange(FRAMES_APART, frames - FRAMES_APART, FRAMES_APART)
    chosen = rng.choice(places, count, replace=False) + rng.integers(0, FRAMES_APART // 2, count)
    return {"at_frames": sorted(int(n) for n in chosen)}


def _pwm(
    rng: np.random.Generator, times: float, frames: int, rate: Fraction, exposure_s: float
) -> dict[str, Any]:
    tone_hz = _tone_hz(rng, 250.0, 2500.0, rate, exposure_s)
    return {"tone_hz": tone_hz, "depth_ratio": times * 5e-4, "phase_rad": _phase(rng)}


def _interharmonic(
    rng: np.random.Generator, times: float, frames: int, rate: Fraction, exposure_s: float
) -> dict[str, Any]:
    flicker_hz = _tone_hz(rng, 1.5, 25.0, rate, 0.0)
    return {"flicker_hz": flicker_hz, "depth_ratio": times * 2e-4, "phase_rad": _phase(rng)}


def _gop(
    rng: np.random.Generator, times: float, frames: int, rate: Fraction, exposure_s: float
) -> dict[str, Any]:
    period = int(rng.choice([12, 15, 24, 25, 30, 48, 50, 60]))
    return {"loss_ratio": times * 0.01, "period_frames": period}


def _readout_drift(
    rng: np.random.Generator, times: float, frames: int, rate: Fraction, exposure_s: float
) -> dict[str, Any]:
    return {"drift_per_min": float(rng.choice([-1, 1])) * times * 0.002}


def _interlace(
    rng: np.random.Generator, times: float, frames: int, rate: Fraction, exposure_s: float
) -> dict[str, Any]:
    return {"bottom_first": bool(rng.integers(2))}


def _nothing(
    rng: np.random.Generator, times: float, frames: int, rate: Fraction, exposure_s: float
) -> dict[str, Any]:
    return {}


LISTED: dict[str, Draw] = {
    "harmonics": _harmonics,
    "gamma": _single("exponent", 0.2, 1.0),
    "frame_drop": _events,
    "frame_duplicate": _events,
    "capture_jitter": _single("jitter_s", 20e-6),
    "auto_exposure": _single("gain_ratio", 0.002),
    "second_lamp": _second_lamp,
    "pwm_tone": _pwm,
    "interharmonic": _interharmonic,
    "gop_attenuation": _gop,
    "row_banding": _single("banding_ratio", 0.003),
    "readout_drift": _readout_drift,
    "variable_frame_rate": _single("rate_ratio", 1e-5),
    "timestamp_jitter": _single("jitter_s", 1e-4),
    "interlace": _interlace,
    "reverse_readout": _nothing,
}
# The parameter by which an effect is strong, to compare with what was found.
SIZE = {
    "harmonics": "second_ratio",
    "gamma": "exponent",
    "capture_jitter": "jitter_s",
    "auto_exposure": "gain_ratio",
    "second_lamp": "weight",
    "pwm_tone": "depth_ratio",
    "interharmonic": "depth_ratio",
    "gop_attenuation": "loss_ratio",
    "row_banding": "banding_ratio",
    "readout_drift": "drift_per_min",
    "timestamp_jitter": "jitter_s",
}
# What the data can't tell apart is right as either.
TWINS = ({"harmonics", "gamma"},)
# What can't be had at once, or would be one and the same.
APART = (*TWINS, {"interlace", "reverse_readout"}, {"frame_drop", "frame_duplicate"})


def _tone_hz(
    rng: np.random.Generator, low_hz: float, high_hz: float, rate: Fraction, exposure_s: float
) -> float:
    """Draw a tone that can be seen: by this shutter, at this frame rate."""
    while True:
        tone_hz = float(rng.uniform(low_hz, high_hz))
        from_multiple_hz = abs(math.remainder(tone_hz, float(rate)))
        if abs(np.sinc(tone_hz * exposure_s)) > SEEN and from_multiple_hz > APART_HZ:
            return tone_hz


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(-math.pi, math.pi))
