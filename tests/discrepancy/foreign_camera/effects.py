"""What can be hidden: effects of the catalogue, things in no catalogue, and what goes together.

Beside them stands what is hard on estimators, of a size that nobody overlooks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import (
    hard_light,
    hard_scene,
    hard_time,
    in_level,
    in_light,
    in_picture,
    in_time,
    odd_camera,
    odd_light,
    physical,
    physical_more,
)
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
        (two or more) or ``"reference"`` (the grid's true frequency); ``"stamps"`` if it is in
        those alone.
    like : tuple of str
        Names of the catalogue that an analyst may fairly give instead, since they do nearly
        the same.
    """

    listed: float
    help: str
    hide: Hide
    none: float = 0.0
    needs: str = ""
    like: tuple[str, ...] = ()

    def size(self, times: float) -> float:
        """That many times the smallest strength."""
        return self.none + times * (self.listed - self.none)


# In the order in which they are put into a plan: what changes the exposure or the timing of rows
# comes before what is measured by them, and the stamps come last.
EFFECTS: dict[str, Effect] = {
    "exposure": Effect(
        listed=0.3, help="another exposure, log of the ratio", hide=in_light.exposure
    ),
    "rows_cropped": Effect(
        listed=0.1, help="share of the rows read that isn't kept", hide=in_time.rows_cropped
    ),
    "interlace": Effect(listed=1.0, help="two fields a frame; no size", hide=in_time.interlace),
    "reverse_readout": Effect(
        listed=1.0, help="from bottom to top; no size", hide=in_time.reverse_readout
    ),
    "pwm_tone": Effect(
        listed=5e-4, help="dimmer at 500 to 5000 Hz, amplitude to mean", hide=in_light.pwm_tone
    ),
    "harmonics": Effect(
        listed=0.003,
        help="more second harmonic than the lamp has, relative to its first",
        hide=in_light.harmonics,
        like=("gamma",),
    ),
    "second_lamp": Effect(
        listed=0.02,
        help="share of the light, in some strips, that another mains phase feeds",
        hide=in_light.second_lamp,
        needs="strips",
    ),
    "interharmonic": Effect(
        listed=2e-4,
        help="a swing of the supply or a tone that is no multiple, amplitude to mean",
        hide=in_light.interharmonic,
    ),
    "readout_drift": Effect(
        listed=0.002,
        help="the read-out time drifts over the film, relative, rms about its mean",
        hide=in_time.readout_drift,
        like=("read_out_tone",),
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
    "moving_object": Effect(
        listed=0.002,
        help="something crosses the picture; relative to level, rms about its mean",
        hide=in_picture.moving_object,
    ),
    "image_wobble": Effect(
        listed=0.02, help="the picture shakes up and down, rows rms", hide=in_picture.image_wobble
    ),
    "gamma": Effect(
        listed=1.2,
        none=1.0,
        help="power law between light and level, or its inverse; the exponent",
        hide=in_level.gamma,
        like=("harmonics",),
    ),
    "gop_attenuation": Effect(
        listed=0.01,
        help="share of the flicker lost in some frames of each group",
        hide=in_level.gop_attenuation,
    ),
    "capture_jitter": Effect(
        listed=20e-6,
        help="frames begin early or late, which their stamps don't say; seconds rms",
        hide=in_time.capture_jitter,
    ),
    "variable_frame_rate": Effect(
        listed=1e-5,
        help="frame interval varies, stamps don't say so; relative, rms about its mean",
        hide=in_time.variable_frame_rate,
        needs="reference",
    ),
    "clock_skew": Effect(
        listed=20.0,
        help="the camera's clock is fast or slow, ppm",
        hide=in_time.clock_skew,
        needs="reference",
    ),
    "frame_drop": Effect(listed=1.0, help="frames lost a minute", hide=in_time.frame_drop),
    "frame_duplicate": Effect(
        listed=1.0, help="frames repeated a minute", hide=in_time.frame_duplicate
    ),
    "timestamp_jitter": Effect(
        listed=20e-6,
        help="stamps are wrong, seconds rms",
        hide=in_time.timestamp_jitter,
        needs="stamps",
    ),
}
NEUTRAL: tuple[str, ...] = ("exposure", "rows_cropped")

_ODD = 0.01  # rms of what they do, relative to the flicker's; ten-thousandth of its power
UNKNOWN: dict[str, Effect] = {
    hide.__name__: Effect(
        listed=_ODD, help=(hide.__doc__ or "").split("\n")[0], hide=hide, like=like
    )
    for hide, like in (
        (odd_light.pulsating_part, ("moving_object",)),
        (odd_light.rolling_bar, ("interharmonic",)),
        (odd_light.shadow_edge, ("moving_object",)),
        (odd_light.saw_gain, ("auto_exposure",)),
        (odd_light.two_levels, ("auto_exposure",)),
        (odd_light.flash_frames, ("moving_object", "light_events")),
        (odd_light.thermal_harmonics, ("harmonics",)),
        (odd_camera.shake_with_gain, ("image_wobble",)),
        (odd_camera.knee, ("gamma",)),
        (odd_camera.s_curve, ("gamma",)),
        (odd_camera.local_dimming, ("row_banding",)),
        (odd_camera.burst_lines, ()),
        (odd_camera.black_drift, ("auto_exposure",)),
        (odd_camera.column_drift, ("image_wobble", "moving_object", "row_banding")),
        (odd_camera.frame_blend, ("gop_attenuation",)),
        (odd_camera.temporal_smoothing, ("codec_lowpass",)),
    )
}

# What a physical program does that is no effect of the catalogue, nor made to be like one.
PHYSICAL: dict[str, Effect] = {
    hide.__name__: Effect(listed=_ODD, help=(hide.__doc__ or "").split("\n")[0], hide=hide, like=())
    for hide in (*physical.PROGRAMS, *physical_more.PROGRAMS)
}

# In the order in which they are put into a plan, after all others. The lamp goes last: sizes are
# relative to its flicker.
HARD: dict[str, Effect] = {
    hide.__name__: Effect(
        listed=size / 3, help=(hide.__doc__ or "").split("\n")[0], hide=hide, like=()
    )
    for hide, size in (
        (hard_light.second_harmonic, 1.5),
        (hard_light.half_wave_part, 2.0),
        (hard_light.several_sources, 1.0),
        (hard_light.pwm, 0.15),
        (hard_light.monitor, 2.0),
        (hard_scene.stripes, 0.3),
        (hard_scene.vibration, 0.3),
        (hard_scene.hand_tilt, 25.0),
        (hard_scene.clouds, 0.05),
        (hard_scene.gain_steps, 0.4),
        (hard_scene.key_dimming, 0.02),
        (hard_time.true_variable_rate, 0.2),
        (hard_time.converted, 1.0),
        (hard_time.blended, 1.0),
        (hard_time.stamp_jitter, 4e-3),
        (hard_light.no_lamp, 1.0),
    )
}

_APART = (
    {"frame_drop", "frame_duplicate"},
    {"capture_jitter", "timestamp_jitter"},
    {"timestamp_jitter", "frame_drop"},
    {"timestamp_jitter", "frame_duplicate"},
    {"variable_frame_rate", "clock_skew"},
    {"interlace", "reverse_readout"},
    {"interlace", "readout_drift"},
    {"interlace", "rows_cropped"},
    {"interlace", "burst_lines"},
    {"exposure", "pwm_tone"},
    {"moving_object", "image_wobble"},
    {"image_wobble", "shake_with_gain"},
    {"gamma", "knee"},
    {"gamma", "s_curve"},
)


def go_together(one: str, other: str) -> bool:
    """Whether a pair is sensible to hide at once: neither undoes nor mimics the other."""
    both = {**EFFECTS, **UNKNOWN}
    mimics = other in both[one].like or one in both[other].like
    return one != other and not mimics and {one, other} not in _APART
