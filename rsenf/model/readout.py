"""Timing of a block of frames: when lines are exposed, and how far the picture is displaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.model.clip import Int64Array
from rsenf.model.grid import FloatArray
from rsenf.model.shutter import Shutter


@dataclass(eq=False)
class ReadOut:
    """A block of frames as the shutter takes them, with times by the camera's clock.

    Attributes
    ----------
    block : int
        Number of the block.
    number : ndarray of int64 (frames,)
        Number of each captured frame.
    start_s : ndarray of float64 (frames,)
        Start of each frame's first line.
    line_s : ndarray of float64 (frames, lines)
        Start of each line's exposure after its frame's start.
    read_out_s : float
        Time from the first line to one past the last, which an idle estimator should find.
    exposure_s : float
        Exposure of a line.
    shift_px : ndarray of float64 (frames, 2)
        Displacement of the scene, along the lines' order and across it.
    """

    block: int
    number: Int64Array
    start_s: FloatArray
    line_s: FloatArray
    read_out_s: float
    exposure_s: float
    shift_px: FloatArray

    @classmethod
    def of(cls, shutter: Shutter, block: int, number: Int64Array, start_s: FloatArray) -> ReadOut:
        """Return the read-out of a plain shutter: ``l · T_ro / L``, instantaneous exposure."""
        frames, lines = number.size, shutter.lines
        line_s = np.arange(lines) * (shutter.read_out_time_s / lines)
        return cls(
            block=block,
            number=number,
            start_s=start_s,
            line_s=np.repeat(line_s[None], frames, axis=0),
            read_out_s=shutter.read_out_time_s,
            exposure_s=0.0,
            shift_px=np.zeros((frames, 2)),
        )
