"""Effects on the light: the lamp's harmonics, a second lamp, and light independent of the mains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.model.effects.base import LightEffect, Run, WaveformEffect
from rsenf.model.effects.search import Hiding, ResidualFeatures, Weakest
from rsenf.model.light import LAMPS, Light
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter

HIGHEST_SOUGHT = 8  # highest harmonic of a search's first fit
HALF_ORDERS = 3  # ½, 1½ and 2½ times the illumination frequency
MOST_HARMONICS = 40
PULSE_HARMONICS = range(1, 41)  # of the light
LEAST_SOUGHT_HZ = 48.0  # of monitors; slower tones count as an interharmonic
SLOWEST_DIMMER_HZ = 200.0  # IEEE Std 1789-2015


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
        fitting=Fitting(0.0, 0.01, turn="higher_phases_rad", most=MOST_HARMONICS),
    )  # fmt: skip
    higher_phases_rad: tuple[float, ...] = parameter(
        (), "phase of each where the 1st has its crest", low=-7, high=7
    )
    half_ratios: tuple[float, ...] = parameter(
        (), "lines at 1/2, 3/2, 5/2 of the 1st harmonic's frequency, over the 1st", low=0, high=4,
        fitting=Fitting(0.0, 0.01, turn="half_phases_rad", most=MOST_HARMONICS),
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
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """Harmonics up to ``HIGHEST_SOUGHT``, without and with half orders."""
        higher = (0.0,) * (HIGHEST_SOUGHT - 3)
        whole = {"higher_ratios": higher, "higher_phases_rad": higher}
        halves = (0.0,) * HALF_ORDERS
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


@dataclass(frozen=True, kw_only=True)
class SecondLamp(LightEffect):
    """A second lamp, on another phase of the mains, lights part of the scene.

    The light of both adds, ``(1 − w)·lamp(φ) + w·other(φ + phase_rad)``. If their shares are equal
    all along a line, the sum is one lamp of another phase and depth; if they vary from left to
    right, so does the phase of the flicker. The lamp replaces a share ``weight`` of the light.
    """

    name = "second_lamp"
    source = "three-phase supply, light phases 2π/3 apart (Sheinin et al., CVPR, 2017)"
    confused_with = ("light phase", "flicker_ratio")
    told_apart_by = "strips from left to right; in row means alone it can't be seen"
    along_lines = True
    weakest = Weakest(0.02, "weight")

    weight: float = parameter(
        0.1, "its mean share of the light", low=0, high=1,
        fitting=Fitting(0.0, 0.02),
    )  # fmt: skip
    phase_rad: float = parameter(
        2 * math.pi / 3, "how far its first harmonic is ahead", low=-7, high=7,
        fitting=Fitting(None, 0.02),
    )  # fmt: skip
    lamp: str = parameter("same", "its kind", choices=("same", *LAMPS))
    tilt_ratio: float = parameter(
        1.0, "its share rises along a line by twice this, from 1 − tilt to 1 + tilt", low=-1, high=1
    )

    def apply(self, light: LineLight, run: Run) -> None:
        """Mix it in, more at one end of the lines than at the other."""
        f0_hz = 2 * light.grid.nominal_hz
        series = None if self.lamp == "same" else Light(lamp=self.lamp).series(f0_hz)
        change = np.float32(self.weight) * (light.lamp(self.phase_rad, series) - light.level)
        light.level = light.level + change
        if self.tilt_ratio:
            slope = np.float32(2 * self.tilt_ratio) * change
            light.slope = slope if light.slope is None else light.slope + slope

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """Phases in steps of π/3 without 0, where it would change nothing, and either side."""
        phases = (math.pi / 3, 2 * math.pi / 3, math.pi, -2 * math.pi / 3, -math.pi / 3)
        return [{"phase_rad": p, "tilt_ratio": tilt} for tilt in (1.0, -1.0) for p in phases]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw one of the other two phases of the supply."""
        phase_rad = hiding.sign() * 2.0 * math.pi / 3.0
        return {**super().hidden(hiding), "phase_rad": phase_rad}


@dataclass(frozen=True, kw_only=True)
class PwmTone(LightEffect):
    """The light contains a tone, or pulses, of a constant frequency.

    ``d·cos(2π·f·t + φ)`` is added: a line at its own frequency, with aliases at all distances of
    whole frame rates, which doesn't move when the grid's frequency does. It is invisible if the
    exposure is a whole number of its periods, and is taken for texture if it is a multiple of the
    frame rate. Pulses have lines at its multiples as well; if they switch all light off, the first
    has the amplitude ``2·sinc(duty)``.
    """

    name = "pwm_tone"
    source = "pulse-width dimming, 200 Hz to 25 kHz; monitors, 50 to 240 Hz; IEEE Std 1789-2015"
    confused_with = ("interharmonic", "harmonics")
    told_apart_by = (
        "its phase ramp down the rows tells its frequency up to aliases of the line rate"
    )
    any_course = True
    weakest = Weakest(5e-4, "depth_ratio")

    tone_hz: float = parameter(
        1000.0, "frequency", low=20, high=50_000,
        fitting=Fitting(None, 1e-4),
    )  # fmt: skip
    depth_ratio: float = parameter(
        0.01, "amplitude of the first line over the mean light", low=0, high=2,
        fitting=Fitting(0.0, 0.002, turn="phase_rad"),
    )  # fmt: skip
    phase_rad: float | None = parameter(
        None, "at the first frame's start; None draws it", low=-7, high=7
    )
    duty_ratio: float | None = parameter(
        None, "share of a period that pulses are on, about its phase 0; None is a pure tone",
        low=0.01, high=0.99,
    )  # fmt: skip

    def apply(self, light: LineLight, run: Run) -> None:
        """Add the tone, with a random phase unless one is given."""
        phase_rad = self.phase_rad
        if phase_rad is None:
            phase_rad = float(run.rng().uniform(-math.pi, math.pi))
        for k, ratio in enumerate(self._lines(), 1):
            tone = light.tone(k * self.tone_hz, k * phase_rad)
            light.level = light.level + np.float32(self.depth_ratio * ratio) * tone

    def _lines(self) -> list[float]:
        """Amplitudes of the lines over the first one's: for a rectangle as ``sin(π·k·d)/k``."""
        duty = self.duty_ratio
        if duty is None:
            return [1.0]
        return [
            math.sin(math.pi * k * duty) / (k * math.sin(math.pi * duty)) for k in PULSE_HARMONICS
        ]

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """The tone that stands out, at its possible aliases."""
        most_hz = cls.__dataclass_fields__["tone_hz"].metadata["high"]
        return [{"tone_hz": f} for f in features.tones_hz if LEAST_SOUGHT_HZ <= f <= most_hz]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the frequency and the phase, too."""
        tone_hz = hiding.tone_hz(250.0, 2500.0)
        return {"tone_hz": tone_hz, **super().hidden(hiding), "phase_rad": hiding.phase_rad()}


@dataclass(frozen=True, kw_only=True)
class Interharmonic(LightEffect):
    """The supply's voltage swings at a frequency between its harmonics, and the light with it.

    All light, flicker included, is multiplied by ``1 + d·cos(2π·f·t + φ)``: a line at its own
    frequency with aliases at multiples of the frame rate, and weak sidebands about the flicker's
    lines.
    """

    name = "interharmonic"
    source = "IEC 61000-4-15 (flicker meter), 0.5 to 33 Hz and above; ripple control"
    confused_with = ("pwm_tone", "auto_exposure")
    told_apart_by = (
        "its alias is one of many: the phase ramp down the rows tells which; near 0 Hz only the "
        "side lines part it from a gain"
    )
    any_course = True
    weakest = Weakest(2e-4, "depth_ratio")

    flicker_hz: float = parameter(
        8.8, "frequency of the light's swing", low=0.1, high=1000,
        fitting=Fitting(None, 1e-4),
    )  # fmt: skip
    depth_ratio: float = parameter(
        0.005, "amplitude over the mean light", low=0, high=0.5,
        fitting=Fitting(0.0, 0.002, turn="phase_rad"),
    )  # fmt: skip
    phase_rad: float | None = parameter(
        None, "at the first frame's start; None draws it", low=-7, high=7
    )

    @property
    def same_as(self) -> tuple[str, ...]:
        """At high frequencies, a dimmer that switches all of the light, its flicker included."""
        return ("pwm_tone",) if self.flicker_hz >= SLOWEST_DIMMER_HZ else ()

    def apply(self, light: LineLight, run: Run) -> None:
        """Multiply by the modulation, with a random phase unless one is given."""
        phase_rad = self.phase_rad
        if phase_rad is None:
            phase_rad = float(run.rng().uniform(-math.pi, math.pi))
        light.scale(1 + np.float32(self.depth_ratio) * light.tone(self.flicker_hz, phase_rad))

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """The tone that stands out, at its possible aliases."""
        meta = cls.__dataclass_fields__["flicker_hz"].metadata
        return [{"flicker_hz": f} for f in features.tones_hz if meta["low"] <= f <= meta["high"]]

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw the frequency and the phase, too."""
        flicker_hz = hiding.tone_hz(1.5, 25.0)
        values = {"flicker_hz": flicker_hz, **super().hidden(hiding)}
        return values | {"phase_rad": hiding.phase_rad()}
