"""The light on the scene, averaged over each line's exposure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.model.grid import FloatArray, GridPath
from rsenf.model.lamp import LAMPS
from rsenf.model.parameters import parameter
from rsenf.model.seeds import generator


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
    """The time over which a line collects light: one exposure, or those of the rows it averages.

    Parameters
    ----------
    exposure_s : float, optional
        Of a row.
    rows : int, optional
        Number of averaged rows.
    row_s : float, optional
        Time from one row to the next.
    """

    exposure_s: float = 0.0
    rows: int = 1
    row_s: float = 0.0

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
    turns = 2 * grid.cycles(middle_s) + phase_rad / (2 * math.pi)
    angle = ((turns - np.floor(turns)) * (2 * math.pi)).astype(np.float32)
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
        turn = ((turns / 2 - np.floor(turns / 2)) * (2 * math.pi)).astype(np.float32)
        first = first + _above(sizes, tone) * np.exp(-1j * (angle + turn)).astype(np.complex64)
    # Only the real part of the sum is needed.
    real *= first.real
    imaginary *= first.imag
    real -= imaginary
    real += np.float32(1)
    return real


def _above(sizes: NDArray[np.complex64], tone: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Sum of the higher harmonics over harmonic 1, by Horner's rule."""
    total = sizes[:, -1:] * tone
    for k in range(sizes.shape[1] - 2, -1, -1):
        total += sizes[:, k, None]
        total *= tone
    return np.asarray(total)
