"""Tone curve of the camera."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.model.effects.base import ToneEffect
from rsenf.model.effects.hiding import Weakest
from rsenf.model.parameters import Fitting, parameter


@dataclass(frozen=True, kw_only=True)
class Gamma(ToneEffect):
    """Levels leave the camera by a power law, ``255 · (light / 255)^exponent``.

    The relative flicker is multiplied by the exponent, and a pure tone gets a second harmonic of
    ``(exponent − 1)/4`` times its relative size. Noise passes the same curve, so that its
    dependence on the level is no longer the sensor's.
    """

    name = "gamma"
    source = "ITU-R BT.709 and sRGB transfer curves; FFmpeg's eq filter"
    confused_with = ("harmonics",)
    told_apart_by = "noise against level, or flicker in bright against dark regions"
    weakest = Weakest(0.2, "exponent", 1.0)

    exponent: float = parameter(
        1.2, "of the power law", low=0.3, high=3.0, fitting=Fitting(1.0, 0.02)
    )

    def apply(self, exponent: float) -> float:
        """Multiply by its exponent: successive power laws are one."""
        return exponent * self.exponent
