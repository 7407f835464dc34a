"""The light on the scene: waveforms of lamps, and their mean over each line's exposure.

A waveform is a Fourier series at the illumination frequency. Harmonic ``k`` is at ``2·k`` times the
grid frequency: light has the same waveform in each half-wave of the mains. Amplitudes and shapes
are typical, not measurements of a product: filament lamps flicker by 6 to 11 % at 100 to 120 Hz,
electronic ballasts leave a few per cent, discharge lamps on magnetic ballasts nearly go out twice a
cycle, and LED drivers range from no to full modulation (IEEE Std 1789-2015 discusses all of them).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.model.grid import FloatArray, GridPath
from rsenf.model.noise import generator
from rsenf.model.parameters import parameter

HARMONICS = 8
_FINE = 4096  # samples of a waveform's period


@dataclass(frozen=True)
class Lamp:
    """Light of a lamp relative to its mean: ``1 + d·Σ a_k·cos(k·φ + θ_k)``."""

    flicker_ratio: float  # ``d``, amplitude of harmonic 1 over the mean
    harmonic_ratios: tuple[float, ...] = ()  # ``a_2, a_3, …``: amplitudes relative to harmonic 1
    # ``θ_2, θ_3, …``: phases at the crest of harmonic 1
    harmonic_phases_rad: tuple[float, ...] = ()


def rectified_cosine(harmonics: int) -> Lamp:
    """``|cos|`` of the mains, the paper's light: ``2·(−1)^(k+1) / (4k² − 1)`` over its mean.

    >>> [round(ratio, 4) for ratio in rectified_cosine(3).harmonic_ratios]
    [-0.2, 0.0857]
    """
    sizes = [2 * (-1) ** (k + 1) / (4 * k * k - 1) for k in range(1, harmonics + 1)]
    return Lamp(sizes[0], tuple(a / sizes[0] for a in sizes[1:]), (0.0,) * (harmonics - 1))


def filament(f0_hz: float, time_constant_s: float, exponent: float = 2.1) -> Lamp:
    """Return the light of an incandescent filament.

    The power swings fully, as ``1 + cos φ``. The filament's heat capacity attenuates the swing to
    ``1/√(1 + (2πf_0τ)²)``. Visible light is a power law of the heat, which gives a small second
    harmonic: light goes as voltage to the 3.4, power as voltage to the 1.6 (lighting engineers'
    rule), hence 2.1.

    Parameters
    ----------
    f0_hz : float
        Illumination frequency.
    time_constant_s : float
        Thermal time constant ``τ``.
    exponent : float, optional
    """
    swing = 1 / math.hypot(1, 2 * math.pi * f0_hz * time_constant_s)
    return sampled((1 + swing * np.cos(_phase())) ** exponent)


def discharge(afterglow: float = 0.08) -> Lamp:
    """Light of an arc on a magnetic ballast, which nearly goes out at each zero of the current."""
    return sampled(afterglow + np.abs(np.cos(_phase() / 2)) ** 1.5)


def direct_led(threshold: float = 0.3) -> Lamp:
    """Light of an LED string without a capacitor; dark below a share ``threshold`` of the crest."""
    return sampled(np.maximum(np.abs(np.cos(_phase() / 2)) - threshold, 0))


def capacitor_led(ripple: float = 0.12, recharge: float = 0.2) -> Lamp:
    """Light of an LED behind a rectifier and a capacitor: a sawtooth.

    The capacitor charges during the share ``recharge`` of each half-wave and discharges in the
    rest; ``ripple`` is peak to peak, over the mean.
    """
    turn = _phase() / (2 * math.pi)
    saw = np.where(turn < recharge, turn / recharge, (1 - turn) / (1 - recharge))
    return sampled(1 + ripple * (saw - 0.5))


def sampled(wave: FloatArray) -> Lamp:
    """Return the lamp whose light over one period is given as equidistant samples."""
    lines = np.fft.rfft(wave)[: HARMONICS + 1] / wave.size
    turned = lines[1:] * np.exp(-1j * np.angle(lines[1]) * np.arange(1, HARMONICS + 1))
    sizes, phases = np.abs(turned), np.angle(turned)
    return Lamp(
        float(2 * sizes[0] / lines[0].real),
        tuple((sizes[1:] / sizes[0]).tolist()),
        tuple(phases[1:].tolist()),
    )


def _phase() -> FloatArray:
    return np.arange(_FINE, dtype=np.float64) * (2 * math.pi / _FINE)


# As functions of the illumination frequency, on which thermal inertia depends.
LAMPS: dict[str, Callable[[float], Lamp]] = {
    "tone": lambda f0_hz: Lamp(0.10),
    "ideal": lambda f0_hz: rectified_cosine(HARMONICS),
    "led": lambda f0_hz: Lamp(0.10, (0.06, 0.02), (0.9, 1.7)),
    "led_capacitor": lambda f0_hz: capacitor_led(),
    "led_direct": lambda f0_hz: direct_led(),
    "led_two_stage": lambda f0_hz: Lamp(0.005, (0.1,), (0.5,)),
    "halogen": lambda f0_hz: filament(f0_hz, 0.042),
    "incandescent": lambda f0_hz: filament(f0_hz, 0.033),
    "cfl": lambda f0_hz: Lamp(0.03, (0.25, 0.10), (1.2, 2.4)),
    "sodium": lambda f0_hz: discharge(),
}


@dataclass(frozen=True, kw_only=True)
class Light:
    """A lamp on the mains, and daylight."""

    lamp: str = parameter("led", "kind of lamp", choices=tuple(LAMPS))
    flicker_ratio: float | None = parameter(
        None, "amplitude of harmonic 1 over the lamp's mean; None is the lamp's own", low=0, high=1
    )
    daylight_ratio: float = parameter(0.0, "share of the mean light that is steady", low=0, high=1)
    phase_rad: float | None = parameter(
        None, "of harmonic 1 at the first frame's start; None draws it", low=-7, high=7
    )

    def drawn_phase_rad(self, seed: int) -> float:
        """Phase of harmonic 1 when line 0 of the first frame begins."""
        if self.phase_rad is not None:
            return self.phase_rad
        return float(generator(seed, "light phase").uniform(-math.pi, math.pi))

    def series(self, f0_hz: float = 100.0) -> NDArray[np.complex128]:
        """Complex amplitudes (harmonics,) relative to the mean light; harmonic 1 is real.

        Parameters
        ----------
        f0_hz : float, optional
            Nominal illumination frequency, on which thermal inertia depends.
        """
        lamp = LAMPS[self.lamp](f0_hz)
        first = lamp.flicker_ratio if self.flicker_ratio is None else self.flicker_ratio
        others = np.multiply(lamp.harmonic_ratios, np.exp(1j * np.array(lamp.harmonic_phases_rad)))
        relative = np.concatenate(([1.0], others))
        return np.asarray(relative * (first * (1 - self.daylight_ratio)), dtype=np.complex128)


@dataclass(frozen=True)
class Aperture:
    """The time over which a line collects light: one exposure, or those of the rows it averages."""

    exposure_s: float = 0.0  # of a row
    rows: int = 1  # number of averaged rows
    row_s: float = 0.0  # time from one row to the next

    @property
    def middle_s(self) -> float:
        """Middle of the aperture, from the start of the first row."""
        return (self.exposure_s + (self.rows - 1) * self.row_s) / 2

    def transfer(self, freq_hz: FloatArray | float) -> FloatArray:
        """Gain at a frequency: ``sinc(f·T_e)`` of the exposure times the rows' Dirichlet kernel.

        >>> Aperture(exposure_s=0.005).transfer(200.0).round(6).item()
        0.0
        """
        gain = np.sinc(np.asarray(freq_hz) * self.exposure_s)
        if self.rows > 1:
            gain = gain * np.sinc(np.asarray(freq_hz) * (self.rows * self.row_s))
            gain = gain / np.sinc(np.asarray(freq_hz) * self.row_s)
        return np.asarray(gain)


def relative_level(
    series: NDArray[np.complex128],
    phase_rad: float,
    grid: GridPath,
    line_start_s: FloatArray,
    aperture: Aperture,
) -> NDArray[np.float32]:
    """Mean light of each line's exposure, relative to the light's own mean.

    Harmonic ``k`` has its phase at the middle of the aperture and is multiplied by the aperture's
    transfer at ``k·f_0``, with ``f_0`` taken once a frame, at the middle line.

    Parameters
    ----------
    series : ndarray of complex128 (harmonics,) or (2, harmonics)
        From :meth:`Light.series`. A lamp with unequal half-waves has a second row, of the lines at
        1/2, 3/2, 5/2 … of the first harmonic's frequency.
    phase_rad : float
        Phase of harmonic 1 at time zero.
    grid : GridPath
        The grid's frequency.
    line_start_s : ndarray of float64 (frames, lines)
        Start of each line's exposure, true time.
    aperture : Aperture
        Of a line, in true seconds.

    Returns
    -------
    ndarray of float32 (frames, lines)
    """
    middle_s = line_start_s + aperture.middle_s
    turns = grid.cycles(middle_s)
    turns *= 2
    turns += phase_rad / (2 * math.pi)
    angle = _angle(turns)
    real, imaginary = np.cos(angle), np.sin(angle)
    f0_hz = 2 * grid.frequency_hz(middle_s[:, middle_s.shape[1] // 2])
    whole, *halves = np.atleast_2d(series)
    order = np.arange(1, whole.size + 1)
    sizes = (whole * aperture.transfer(f0_hz[:, None] * order)).astype(np.complex64)
    first = sizes[:, :1]
    tone = np.empty(angle.shape if series.size > 1 else (0, 0), np.complex64)
    if series.size > 1:
        tone.real, tone.imag = real, imaginary
    if whole.size > 1:
        first = first + _above(sizes[:, 1:], tone)
    for half in halves:  # half orders repeat after two periods of the light
        sizes = (half * aperture.transfer(f0_hz[:, None] * (order - 0.5))).astype(np.complex64)
        turned = np.exp(-1j * (angle + _angle(turns / 2))).astype(np.complex64)
        first = first + _above(sizes, tone) * turned
    # Only the real part of the sum is needed.
    real *= first.real
    imaginary *= first.imag
    real -= imaginary
    real += np.float32(1)
    return real


def _angle(turns: FloatArray) -> NDArray[np.float32]:
    """Return turns as an angle of less than a turn (rad)."""
    return np.asarray((turns - np.floor(turns)) * (2 * math.pi), np.float32)


def _above(sizes: NDArray[np.complex64], tone: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Sum of the higher harmonics over harmonic 1, by Horner's rule."""
    total = sizes[:, -1:] * tone
    for k in range(sizes.shape[1] - 2, -1, -1):
        total += sizes[:, k, None]
        total *= tone
    return np.asarray(total)
