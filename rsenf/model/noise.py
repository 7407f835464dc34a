"""Noise of the sensor (shot, read, quantisation to 8 bits), and the random numbers of a simulation.

There is one generator for each purpose and each block of frames; its numbers depend on seed,
purpose and block only. So a clip is the beginning of a longer one, and changing one part doesn't
change the noise of another.

Drawing a million normal numbers a frame would take ten times longer than everything else. So the
pixel noise of a row is a section of a long bank at a random position, drawn anew for every row of
every frame. Given the bank, row means are independent and identically distributed in time and down
the frame; only single pixels repeat, every few thousand rows.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.model.parameters import parameter

BANK = 1 << 22
WHITE = 255.0
QUANTISATION_VAR = 1 / 12  # of a uniform error of one level
_DARK = 1.0  # least level at which the tone curve's slope is evaluated
Float32Array = NDArray[np.float32]
Int64Array = NDArray[np.int64]


def generator(seed: int, purpose: str, block: int = 0) -> np.random.Generator:
    """Return the generator for one purpose and one block.

    Parameters
    ----------
    seed : int
        The simulation's seed, 0 or more.
    purpose : str
        What the numbers are for, for example ``"row noise"``.
    block : int, optional
        Which block of frames.
    """
    return np.random.default_rng([seed, zlib.crc32(purpose.encode()), block])


class NoiseBank:
    """Standard normal noise for rows of a fixed length.

    Parameters
    ----------
    columns : int
        Pixels in a row.
    seed : int
        Seed of the simulation.
    """

    def __init__(self, columns: int, seed: int) -> None:
        bank = generator(seed, "pixel noise").standard_normal(BANK, dtype=np.float32)
        bank -= bank.mean()
        bank /= bank.std()
        ring = np.concatenate((bank, bank[: columns - 1]))
        self._rows = np.lib.stride_tricks.sliding_window_view(ring, columns)

    def places(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Int64Array:
        """Draw random positions in the bank, where rows begin."""
        return rng.integers(0, BANK, shape)

    def rows(self, places: Int64Array) -> Float32Array:
        """Noise of rows that begin at given positions, (len(places), columns), as a copy."""
        return self._rows[places]


def wander(
    rng: np.random.Generator, count: int, step_s: float, time_constant_s: float
) -> NDArray[np.float64]:
    """Draw an Ornstein-Uhlenbeck process of unit variance (Uhlenbeck and Ornstein 1930).

    Its correlation falls to 1/e in a time constant; its power is halved at
    ``1 / (2π · time_constant_s)``. A longer series begins with the shorter.

    Parameters
    ----------
    rng : numpy.random.Generator
    count : int
        Number of values.
    step_s : float
        Time between them.
    time_constant_s : float
        0 for white noise.
    """
    kicks = rng.standard_normal(count)
    if not time_constant_s:
        return kicks
    stay = math.exp(-step_s / time_constant_s)
    kicks[1:] *= math.sqrt(1 - stay * stay)
    values, now = kicks.tolist(), 0.0
    for k, kick in enumerate(values):
        values[k] = now = stay * now + kick
    return np.array(values)


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A linear sensor with a given number of electrons at white."""

    white_e: float = parameter(12000.0, "electrons of a pixel at level 255", low=100, high=1e6)
    read_noise_e: float = parameter(15.0, "read noise, electrons rms", low=0, high=1000)

    def variance(self, level: Float32Array, exponent: float = 1.0) -> Float32Array:
        """Noise variance of a pixel (levels²) at a level, without quantisation (EMVA 1288, 2021).

        Parameters
        ----------
        level : ndarray of float32
            8-bit level as it leaves the camera.
        exponent : float, optional
            Of the camera's tone curve: the noise is the sensor's at the light that gives this
            level, times the curve's slope there.
        """
        if exponent == 1:
            return self._linear(level)
        light = (np.maximum(level, np.float32(_DARK)) / WHITE) ** (1 / exponent)
        slope = exponent * light ** (exponent - 1)
        variance = self._linear(np.asarray(light * WHITE, np.float32)) * slope * slope
        return np.asarray(variance, np.float32)

    def _linear(self, level: Float32Array) -> Float32Array:
        read_noise = self.read_noise_e * WHITE / self.white_e
        return np.asarray(np.maximum(level, 0) * (WHITE / self.white_e) + read_noise**2)
