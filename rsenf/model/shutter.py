"""The rolling shutter: when each row of each frame is exposed."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rsenf.model.grid import FloatArray
from rsenf.model.parameters import ParameterError, parameter

NTSC_30 = Fraction(30000, 1001)


@dataclass(frozen=True, kw_only=True)
class Shutter:
    """A shutter that rolls from the top to the bottom, and the clock that drives it.

    All its times are in the camera's own clock, which is fast by ``clock_ppm``: a camera second
    is ``1 / (1 + clock_ppm·1e-6)`` true seconds, so the ENF it sees reads low.
    """

    frame_rate: Fraction = parameter(
        NTSC_30, "frames per second of the camera's clock", low=1, high=1000
    )
    rows: int = parameter(720, "rows of a frame", low=16, high=8192)
    columns: int = parameter(1280, "columns of a frame", low=16, high=8192)
    idle_ratio: float = parameter(
        0.38, "share of the frame period in which no row is read", low=0, high=0.99
    )
    exposure_s: float = parameter(0.002, "exposure of a row", low=0, high=1)
    clock_ppm: float = parameter(0.0, "error of the camera's clock, fast > 0", low=-1e4, high=1e4)

    @property
    def read_out_time_s(self) -> float:
        """Time from row 0 to one past the last row: ``T_ro = (1 − ρ) / F_r``."""
        return (1 - self.idle_ratio) / float(self.frame_rate)

    @property
    def clock_factor(self) -> float:
        """Camera seconds in a true second."""
        return 1 + self.clock_ppm * 1e-6

    def row_start_s(self, frame_number: NDArray[np.int64]) -> FloatArray:
        """Start of exposure of every row: true seconds since row 0 of frame 0.

        Parameters
        ----------
        frame_number : ndarray of int64 (frames,)
            Number of each frame as it was captured, from 0.

        Returns
        -------
        ndarray of float64 (frames, rows)
        """
        row_s = np.arange(self.rows) * (self.read_out_time_s / self.rows)
        return np.asarray(
            (frame_number[:, None] / float(self.frame_rate) + row_s) / self.clock_factor
        )

    def validate(self) -> None:
        """Check what no single range can.

        Raises
        ------
        ParameterError
            When a row is still exposed when its next frame begins.
        """
        if self.exposure_s > 1 / self.frame_rate:
            raise ParameterError(
                ("shutter", "exposure_s"),
                f"is {self.exposure_s:g}, longer than a frame",
                f"at most {float(1 / self.frame_rate):.4g} at {self.frame_rate} fps",
            )

    def effects(self) -> list[dict[str, object]]:
        """Name what this shutter does beyond sampling the light at points of a right clock."""
        found: list[dict[str, object]] = []
        if self.exposure_s:
            found.append({"name": "exposure", "parameters": {"exposure_s": self.exposure_s}})
        if self.clock_ppm:
            found.append({"name": "clock_skew", "parameters": {"clock_ppm": self.clock_ppm}})
        return found
