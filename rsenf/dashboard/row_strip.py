"""The rows of the last frames side by side: an image of the rolling bands."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rsenf.dashboard.tail import BLANK, Columns
from rsenf.messages import RowBlock

FRAMES = 240  # columns of the image
ROWS = 96  # most rows of the image
BASE_S = 60.0  # averaging time of a row's static level
SCALE_S = 10.0  # averaging time of the rms deviation
SPAN = 3.0  # rms deviations at the ends of the grey scale
LEAST_LEVEL = 0.01


class RowStrip:
    """Converts row blocks to columns of grey: each row's level less its mean of the last minute.

    If the frame rate divides the light's frequency (alias at 0 Hz), the bands stand still and are
    mostly subtracted; only the drift of the grid shows.

    Attributes
    ----------
    columns : Columns
        One for each frame, from the first row down; 1 to 255, 128 for a row's mean.
    rms_level : float
        Recent root mean square deviation, in 8-bit levels.
    frame_rate_hz : float
        Frame rate of the latest block.
    """

    def __init__(self) -> None:
        self.columns = Columns(FRAMES)
        self.rms_level = self.frame_rate_hz = float("nan")
        self._base: NDArray[np.float64] | None = None
        self._next_frame = 0
        self._seen_s = 0.0

    def update(self, block: RowBlock) -> None:
        """Add a block."""
        level = row_level(block)
        if not level.size:
            return
        level = _fewer_rows(level)
        duration_s = _duration_s(block)
        self.frame_rate_hz = block.frames / duration_s
        if self._base is None or self._base.size != level.shape[1]:
            self._base, self._seen_s = level.mean(axis=0), 0.0
            self.rms_level, self._next_frame = float("nan"), int(block.frame_number[0])
        self._seen_s += duration_s
        self._base += (level.mean(axis=0) - self._base) * _weight(duration_s, BASE_S, self._seen_s)
        deviation = level - self._base
        rms = max(float(np.sqrt(np.mean(deviation**2))), LEAST_LEVEL)
        known = math.isfinite(self.rms_level)
        weight = _weight(duration_s, SCALE_S, self._seen_s) if known else 1.0
        self.rms_level = rms if not known else self.rms_level + (rms - self.rms_level) * weight
        grey = 128.0 + 127.0 / SPAN * deviation / self.rms_level
        self._add(block, np.clip(np.rint(grey), BLANK + 1, 255).astype(np.uint8))

    def _add(self, block: RowBlock, grey: NDArray[np.uint8]) -> None:
        """Add a column for each frame, and blank ones for missing frames."""
        for number, column in zip(block.frame_number.tolist(), grey, strict=True):
            self.columns.add_blank(number - self._next_frame)
            self.columns.add(column[None])
            self._next_frame = number + 1


def row_level(block: RowBlock) -> NDArray[np.float64]:
    """Return levels averaged over strips, shape (frames, rows), clipped to 0 to 255.

    Invalid values of foreign blocks are accepted: NaN becomes 0.
    """
    level = np.asarray(block.level, np.float64).reshape(block.frames, block.rows, -1)
    if not level.size:
        return np.zeros((0, 0))
    return np.asarray(np.clip(np.nan_to_num(level), 0.0, 255.0).mean(axis=2))


def _fewer_rows(level: NDArray[np.float64]) -> NDArray[np.float64]:
    """Average neighbouring rows so that at most ROWS are left."""
    rows = level.shape[1]
    edges = np.unique(np.arange(min(ROWS, rows)) * rows // min(ROWS, rows))
    counts = np.diff([*edges.tolist(), rows])
    return np.asarray(np.add.reduceat(level, edges, axis=1) / counts)


def _duration_s(block: RowBlock) -> float:
    pts_ns = block.frame_pts_ns
    if block.frames < 2 or pts_ns[-1] <= pts_ns[0]:
        return 1 / 30
    return float(pts_ns[-1] - pts_ns[0]) * 1e-9 * block.frames / (block.frames - 1)


def _weight(step_s: float, within_s: float, seen_s: float) -> float:
    """Weight of a new value in an exponential mean; a plain mean during the first ``within_s``."""
    return step_s / min(max(seen_s, step_s), within_s)
