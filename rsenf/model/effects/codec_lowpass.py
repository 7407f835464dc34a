"""Temporal low-pass of an encoder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.model.effects.base import CodecEffect, Run
from rsenf.model.effects.residue import Residue
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter
from rsenf.model.scene import Float32Array

STANDS_OUT = 8.0  # robust standard deviations of the frames' flicker


@dataclass(frozen=True, kw_only=True)
class CodecLowpass(CodecEffect):
    """Predicted frames take over only a share of each change: ``y += gain · (x − y)``.

    The flicker passes a first-order low-pass at its alias frequency ``f``: with
    ``z = exp(2πj·f/F_r)`` the transfer function is ``gain / (1 − (1 − gain)/z)``. An alias at 0 Hz
    passes unchanged, one near half the frame rate hardly passes.
    """

    name = "codec_lowpass"
    source = "measured on x264 at 50 to 150 kbit/s; a first-order picture"
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
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """Gain from the amplitude of the flicker relative to that in the first frame, a key frame.

        If the clip doesn't begin with a key frame, an attenuated pure tone is just a weaker tone.
        """
        size = residue.size_ratio
        usual = float(np.median(size))
        spread = 1.4826 * float(np.median(np.abs(size - usual)))
        if size[0] < usual + STANDS_OUT * spread:
            return []
        gain = np.linspace(0.01, 0.99, 99)
        turn = np.exp(-2j * np.pi * residue.turns_per_frame)
        kept = gain / np.abs(1.0 - (1.0 - gain) * turn)
        return [{"gain": float(gain[np.argmin(np.abs(kept - usual / size[0]))])}]
