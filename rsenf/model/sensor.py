"""The sensor: shot noise, read noise, and quantisation to 8 bits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.model.parameters import parameter

WHITE = 255.0
QUANTISATION_VAR = 1 / 12  # of a uniform error of one level

Float32Array = NDArray[np.float32]
_DARK = 1.0  # least level at which the tone curve's slope is evaluated


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A linear sensor with a given number of electrons at white."""

    white_e: float = parameter(12000.0, "electrons of a pixel at level 255", low=100, high=1e6)
    read_noise_e: float = parameter(15.0, "read noise, electrons rms", low=0, high=1000)

    def variance(self, level: Float32Array, exponent: float = 1.0) -> Float32Array:
        """Noise variance of a pixel (levels²) at a level, without quantisation.

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
