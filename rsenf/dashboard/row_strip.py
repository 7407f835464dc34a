"""The rows of the last frames side by side: rolling bands as an operator would see them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rsenf.dashboard.tail import BLANK, Columns
from rsenf.messages import RowBlock

FRAMES = 240  # shown
ROWS = 96  # shown, at most
BASE_S = 60.0  # over which a row's own level is taken
SCALE_S = 10.0
SPAN = 3.0  # rms deviations to the ends of the grey scale
LEAST_LEVEL = 0.01


class RowStrip:
    """Turns row blocks into columns of grey: each row's level less its mean of the last minute.

    Where the frame rate divides the light's frequency the bands stand still, and show only as far
    as the grid wanders.

    Attributes
    ----------
    columns : Columns
        One a frame, from the first row down; 1 to 255, 128 for a row's own mean.
    rms_level : float
        Root mean square deviation of late, in 8-bit levels.
    frame_rate_hz : float
        Of the latest block.
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
        """Add a column for each frame, and blank ones for those that never came."""
        for number, column in zip(block.frame_number.tolist(), grey, strict=True):
            self.columns.add_blank(number - self._next_frame)
            self.columns.add(column[None])
            self._next_frame = number + 1


def row_level(block: RowBlock) -> NDArray[np.float64]:
    """Level by frame and row, all strips together, whatever was sent: from 0 to 255."""
    level = np.asarray(block.level, np.float64).reshape(block.frames, block.rows, -1)
    if not level.size:
        return np.zeros((0, 0))
    return np.asarray(np.clip(np.nan_to_num(level), 0.0, 255.0).mean(axis=2))


def _fewer_rows(level: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of neighbouring rows."""
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
    """Of what is new in a mean that forgets; a plain mean until there is enough to forget."""
    return step_s / min(max(seen_s, step_s), within_s)
