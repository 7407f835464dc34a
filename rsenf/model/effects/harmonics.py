"""Harmonics of the light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.model.effects.base import WaveformEffect
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.parameters import Fitting, parameter


@dataclass(frozen=True, kw_only=True)
class Harmonics(WaveformEffect):
    """The light isn't a pure tone: it has lines at two and three times the illumination frequency.

    Each line ``k·f_0`` repeats at ``k·f_0 ± m·F_r`` in the concatenated rows, with its own
    ``sinc(k·c − m)``, and ramps ``k`` times as fast down the frame. It replaces what the lamp has
    of its own above the first harmonic.
    """

    name = "harmonics"
    source = "IEEE Std 1789-2015; Fourier series of |cos| for rectified light"
    confused_with = ("gamma", "pwm_tone")
    told_apart_by = (
        "gamma bends all levels alike: compare bright with dark regions, and noise with level; "
        "a PWM tone doesn't follow the mains"
    )
    weakest = Weakest(0.003, "second_ratio")
    never_with = ("gamma",)

    second_ratio: float = parameter(
        0.05, "2nd harmonic over the 1st", low=0, high=1,
        fitting=Fitting(0.0, 0.01, turn="second_phase_rad"),
    )  # fmt: skip
    third_ratio: float = parameter(
        0.0, "3rd harmonic over the 1st", low=0, high=1,
        fitting=Fitting(0.0, 0.01, turn="third_phase_rad"),
    )  # fmt: skip
    second_phase_rad: float = parameter(
        0.0, "phase of the 2nd where the 1st has its crest", low=-7, high=7
    )
    third_phase_rad: float = parameter(
        0.0, "phase of the 3rd where the 1st has its crest", low=-7, high=7
    )

    def apply(self, series: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Keep the first harmonic; the others are these."""
        second = self.second_ratio * np.exp(1j * self.second_phase_rad)
        third = self.third_ratio * np.exp(1j * self.third_phase_rad)
        return np.asarray(series[0] * np.array([1.0, second, third]))

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the phase, too."""
        return {**super().hidden(hiding), "second_phase_rad": hiding.phase_rad()}
