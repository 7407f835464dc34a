"""Harmonics of the light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.model.effects.base import WaveformEffect
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.effects.residue import Residue
from rsenf.model.parameters import Fitting, parameter

HIGHEST = 8  # highest harmonic of a search's first fit
HALVES = 3  # ½, 1½ and 2½ times the illumination frequency
MOST = 40


@dataclass(frozen=True, kw_only=True)
class Harmonics(WaveformEffect):
    """The light isn't a pure tone: it has lines at multiples of the illumination frequency.

    Each line ``k·f_0`` appears at ``k·f_0 ± m·F_r`` in the concatenated rows, with amplitudes
    ``sinc(k·c − m)``, and its phase ramp down the frame is ``k`` times as steep. All lines follow
    the grid. A lamp with unequal half-waves also has lines at odd multiples of ``f_0/2``. The
    effect replaces the lamp's own harmonics above the first.
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
        0.05, "2nd harmonic over the 1st", low=0, high=4,
        fitting=Fitting(0.0, 0.01, turn="second_phase_rad"),
    )  # fmt: skip
    third_ratio: float = parameter(
        0.0, "3rd harmonic over the 1st", low=0, high=4,
        fitting=Fitting(0.0, 0.01, turn="third_phase_rad"),
    )  # fmt: skip
    second_phase_rad: float = parameter(
        0.0, "phase of the 2nd where the 1st has its crest", low=-7, high=7
    )
    third_phase_rad: float = parameter(
        0.0, "phase of the 3rd where the 1st has its crest", low=-7, high=7
    )
    higher_ratios: tuple[float, ...] = parameter(
        (), "4th, 5th and further harmonics over the 1st", low=0, high=4,
        fitting=Fitting(0.0, 0.01, turn="higher_phases_rad", most=MOST),
    )  # fmt: skip
    higher_phases_rad: tuple[float, ...] = parameter(
        (), "phase of each where the 1st has its crest", low=-7, high=7
    )
    half_ratios: tuple[float, ...] = parameter(
        (), "lines at 1/2, 3/2, 5/2 of the 1st harmonic's frequency, over the 1st", low=0, high=4,
        fitting=Fitting(0.0, 0.01, turn="half_phases_rad", most=MOST),
    )  # fmt: skip
    half_phases_rad: tuple[float, ...] = parameter(
        (), "phase of each where the 1st has its crest, every second time", low=-7, high=7
    )

    def apply(self, series: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Keep the first harmonic and replace the others."""
        ratios = [self.second_ratio, self.third_ratio, *self.higher_ratios]
        phases = [self.second_phase_rad, self.third_phase_rad, *self.higher_phases_rad]
        whole = np.concatenate([[1.0], _complex(ratios, phases)])
        if not self.half_ratios:
            return np.asarray(series[..., 0].ravel()[0] * whole)
        both = np.zeros((2, max(whole.size, len(self.half_ratios))), np.complex128)
        both[0, : whole.size] = whole
        both[1, : len(self.half_ratios)] = _complex(self.half_ratios, self.half_phases_rad)
        return np.asarray(series[..., 0].ravel()[0] * both)

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """Harmonics up to ``HIGHEST``, without and with half orders."""
        higher = (0.0,) * (HIGHEST - 3)
        whole = {"higher_ratios": higher, "higher_phases_rad": higher}
        halves = (0.0,) * HALVES
        return [whole, whole | {"half_ratios": halves, "half_phases_rad": halves}]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the phase, too."""
        return {**super().hidden(hiding), "second_phase_rad": hiding.phase_rad()}


def _complex(ratios: Sequence[float], phases_rad: Sequence[float]) -> NDArray[np.complex128]:
    """Return complex amplitudes; missing phases are 0."""
    phases = np.zeros(len(ratios))
    phases[: len(phases_rad)] = phases_rad[: len(ratios)]
    return np.asarray(np.asarray(ratios) * np.exp(1j * phases), np.complex128)
