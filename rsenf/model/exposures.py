"""A capture as numbers: for each block of frames, which arrive, when, and how bright each row is.

Both depths start here, so they share grid, light, shutter and delivery to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.model.capture_model import CaptureModel
from rsenf.model.delivery import Int64Array
from rsenf.model.grid import FloatArray, GridPath
from rsenf.model.light import relative_level

BLOCK_FRAMES = 64


@dataclass(frozen=True, eq=False)
class Exposure:
    """One block of delivered frames."""

    block: int
    stamp: Int64Array  # (frames,) presentation time in frame periods
    start_s: FloatArray  # (frames,) true time of row 0
    gain: NDArray[np.float32]  # (frames, rows) light relative to its mean


class Capture:
    """A model on a grid path for a time.

    Parameters
    ----------
    model : CaptureModel
        The capture; it is validated.
    grid : GridPath
        The grid's frequency, and where on it the camera starts.
    duration_s : float or None
        Length of the clip by the camera's clock; None is until the path ends.
    seed : int
        Seed of everything random.

    Raises
    ------
    UsageError
        When the model isn't plausible, or the clip doesn't fit on the path.
    """

    def __init__(
        self, model: CaptureModel, grid: GridPath, duration_s: float | None, seed: int
    ) -> None:
        model.validate()
        shutter = model.shutter
        if seed < 0:
            raise UsageError(f"the seed is {seed}, not 0 or more")
        if duration_s is None:
            duration_s = (grid.length_s - 1) * shutter.clock_factor
        self.model, self.grid, self.seed = model, grid, seed
        self.captured = max(round(duration_s * shutter.frame_rate), 0)
        self.duration_s = float(self.captured / shutter.frame_rate)
        if not self.captured:
            raise UsageError(f"a clip of {duration_s:g} s at {shutter.frame_rate} fps has no frame")
        if self.true_duration_s > grid.length_s:
            raise UsageError(
                f"the clip of {self.duration_s:g} s is longer than the grid path, which has "
                f"{grid.length_s:g} s left at {grid.start_s:g} s",
                "shorten the clip or start it earlier",
            )
        self.phase_rad = model.light.drawn_phase_rad(seed)
        self.dropped = model.delivery.dropped(self.captured, shutter.frame_rate, seed)

    @property
    def true_duration_s(self) -> float:
        """Length of the clip in true seconds."""
        return self.duration_s / self.model.shutter.clock_factor

    @property
    def delivered(self) -> int:
        """Frames that arrive."""
        return self.captured - self.dropped.size

    def exposures(self) -> Iterator[Exposure]:
        """Yield the clip block by block; blocks are cut at fixed numbers of captured frames."""
        shutter, series = self.model.shutter, self.model.light.series()
        exposure_s = shutter.exposure_s / shutter.clock_factor
        for block, first in enumerate(range(0, self.captured, BLOCK_FRAMES)):
            number = np.arange(first, min(first + BLOCK_FRAMES, self.captured))
            number = number[~np.isin(number, self.dropped)]
            row_start_s = shutter.row_start_s(number)
            yield Exposure(
                block=block,
                stamp=self.model.delivery.stamp(number, self.dropped),
                start_s=row_start_s[:, 0],
                gain=relative_level(series, self.phase_rad, self.grid, row_start_s, exposure_s),
            )
