"""Lamps: the waveform of each as a Fourier series at the illumination frequency.

Harmonic ``k`` is at ``2·k`` times the grid frequency, whatever lights on each half-wave does.
Sizes and shapes are typical ones, not measurements of one product: flicker of filament lamps is
6 to 11 % at 100 to 120 Hz, electronic ballasts leave a few per cent, and LED drivers range from
nothing to everything (IEEE Std 1789-2015 discusses all of them); the filament's heat capacity
smooths its light to nearly a pure tone, while smoothed rectifiers leave sharper crests.
"""

from __future__ import annotations

from dataclasses import dataclass

IDEAL_HARMONICS = 8


@dataclass(frozen=True)
class Lamp:
    """A lamp's light, relative to its mean: ``1 + d·Σ a_k·cos(k·φ + θ_k)``.

    Parameters
    ----------
    flicker_ratio : float
        ``d``, amplitude of the first harmonic over the mean.
    harmonic_ratios : tuple of float
        ``a_2, a_3, …``: amplitudes relative to the first.
    harmonic_phases_rad : tuple of float
        ``θ_2, θ_3, …``: phases where the first harmonic's crest is.
    """

    flicker_ratio: float
    harmonic_ratios: tuple[float, ...] = ()
    harmonic_phases_rad: tuple[float, ...] = ()


def rectified_cosine(harmonics: int) -> Lamp:
    """``|cos|`` of the mains, the paper's light: ``2·(−1)^(k+1) / (4k² − 1)`` over its mean."""
    sizes = [2 * (-1) ** (k + 1) / (4 * k * k - 1) for k in range(1, harmonics + 1)]
    return Lamp(sizes[0], tuple(a / sizes[0] for a in sizes[1:]), (0.0,) * (harmonics - 1))


LAMPS = {
    "ideal": rectified_cosine(IDEAL_HARMONICS),
    "led": Lamp(0.10, (0.06, 0.02), (0.9, 1.7)),
    "halogen": Lamp(0.08, (0.015,), (0.6,)),
    "incandescent": Lamp(0.10, (0.010,), (0.6,)),
    "cfl": Lamp(0.03, (0.25, 0.10), (1.2, 2.4)),
}
