"""Lamps: the Fourier series of each one's waveform at the illumination frequency.

Harmonic ``k`` is at ``2·k`` times the grid frequency: light has the same waveform in each half-wave
of the mains. Amplitudes and shapes are typical, not measurements of a product: filament lamps
flicker by 6 to 11 % at 100 to 120 Hz, electronic ballasts leave a few per cent, discharge lamps on
magnetic ballasts nearly go out twice a cycle, and LED drivers range from no to full modulation
(IEEE Std 1789-2015 discusses all of them).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rsenf.model.grid import FloatArray

HARMONICS = 8
_FINE = 4096  # samples of a waveform's period


@dataclass(frozen=True)
class Lamp:
    """Light of a lamp relative to its mean: ``1 + d·Σ a_k·cos(k·φ + θ_k)``.

    Parameters
    ----------
    flicker_ratio : float
        ``d``, amplitude of harmonic 1 over the mean.
    harmonic_ratios : tuple of float
        ``a_2, a_3, …``: amplitudes relative to harmonic 1.
    harmonic_phases_rad : tuple of float
        ``θ_2, θ_3, …``: phases at the crest of harmonic 1.
    """

    flicker_ratio: float
    harmonic_ratios: tuple[float, ...] = ()
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
