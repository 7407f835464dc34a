"""The sensor: shot noise, read noise, and eight bits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rsenf.model.parameters import parameter

WHITE = 255.0
QUANTISATION_VAR = 1 / 12  # of a uniform error of one level

A = TypeVar("A", float, NDArray[np.float32])


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A linear sensor whose white is a number of electrons."""

    white_e: float = parameter(12000.0, "electrons of a pixel at level 255", low=100, high=1e6)
    read_noise_e: float = parameter(15.0, "read noise, electrons rms", low=0, high=1000)

    def variance(self, level: A) -> A:
        """Noise variance of a pixel, levels², at a level; quantisation not included."""
        return level * (WHITE / self.white_e) + (self.read_noise_e * WHITE / self.white_e) ** 2
