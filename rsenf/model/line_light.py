"""The light on each line of a block of frames."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.model.grid import FloatArray, GridPath
from rsenf.model.light import Aperture, relative_level
from rsenf.model.noise import Float32Array
from rsenf.model.shutter import Int64Array


@dataclass(eq=False)
class LineLight:
    """Light of a block of frames relative to its own mean, with times in true seconds."""

    number: Int64Array  # (frames,) number of each captured frame
    start_s: FloatArray  # (frames, lines) start of each line's exposure
    aperture: Aperture  # of a line
    grid: GridPath  # the grid's frequency
    series: NDArray[np.complex128]  # (harmonics,) the lamp's waveform
    phase_rad: float  # its phase at time zero
    level: Float32Array  # (frames, lines) the light at the middle of each line
    # (frames, lines) linear change from the first to the last pixel of a line; None for no change
    slope: Float32Array | None = None
    # (lines,) 8-bit levels that the read-out adds to each line; None for nothing
    offset: Float32Array | None = None

    def lamp(
        self, phase_rad: float = 0.0, series: NDArray[np.complex128] | None = None
    ) -> Float32Array:
        """Light of a lamp on the same grid, (frames, lines).

        Parameters
        ----------
        phase_rad : float, optional
            By which it leads the block's own lamp.
        series : ndarray of complex128, optional
            Its waveform; by default the own lamp's.
        """
        return relative_level(
            self.series if series is None else series,
            self.phase_rad + phase_rad, self.grid, self.start_s, self.aperture,
        )  # fmt: skip

    def tone(self, freq_hz: float, phase_rad: float) -> Float32Array:
        """Cosine of unit amplitude and constant frequency after the exposure, (frames, lines).

        Parameters
        ----------
        freq_hz : float
        phase_rad : float
            At time zero.
        """
        turns = freq_hz * (self.start_s + self.aperture.middle_s) + phase_rad / (2 * np.pi)
        angle = ((turns - np.floor(turns)) * (2 * np.pi)).astype(np.float32)
        return np.asarray(np.float32(self.aperture.transfer(freq_hz)) * np.cos(angle))

    def scale(self, gain: FloatArray | Float32Array) -> None:
        """Multiply all light by a gain, broadcast over frames and lines."""
        self.level = np.asarray(self.level * gain, np.float32)
        if self.slope is not None:
            self.slope = np.asarray(self.slope * gain, np.float32)

    def scale_flicker(self, gain: FloatArray | Float32Array) -> None:
        """Multiply the deviation from the mean light by a gain, broadcast over frames and lines."""
        its = np.asarray(gain, np.float32)
        self.level = 1 + its * (self.level - 1)
        if self.slope is not None:
            self.slope = its * self.slope

    def bend(self, exponent: float) -> None:
        """Apply a power law to the light; to the slope, which is small, to first order."""
        if exponent == 1:
            return
        self.level = np.maximum(self.level, np.float32(1e-6))
        if self.slope is not None:
            self.slope = np.asarray(exponent * self.level ** (exponent - 1) * self.slope)
        self.level = np.asarray(self.level**exponent)

    def frame_before(self, block: LineLight | None) -> LineLight:
        """Return the light of each previous frame, given the block before; the first keeps its."""
        first = self if block is None else block.take(np.array([-1]))
        earlier = self.take(np.maximum(np.arange(len(self.level)) - 1, 0))
        earlier.level[0] = first.level[0]
        if earlier.slope is not None and first.slope is not None:
            earlier.slope[0] = first.slope[0]
        return earlier

    def blend(self, other: LineLight, share: FloatArray) -> None:
        """Mix in another light of the same frames, with a share for each frame."""
        its = np.asarray(share, np.float32)[:, None]
        self.level = (1 - its) * self.level + its * other.level
        if self.slope is not None and other.slope is not None:
            self.slope = (1 - its) * self.slope + its * other.slope

    def take(self, index: Int64Array) -> LineLight:
        """Return the light of selected frames, which may repeat."""
        return dataclasses.replace(
            self, number=self.number[index], start_s=self.start_s[index], level=self.level[index],
            slope=None if self.slope is None else self.slope[index],
        )  # fmt: skip
