"""Spectrogram of the concatenated rows: what a person sees of the flicker's lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import RowBlock

# Row means kept for each frame: enough for lines up to 240 Hz at 30 frames/s, little to keep.
KEPT_ROWS = 16
WINDOW_S, STEP_S = 10.0, 2.0


class ThinRows:
    """Row means averaged down to a few a frame, so that hours of video fit in memory."""

    def __init__(self) -> None:
        self._parts: list[NDArray[np.float32]] = []
        self.frame_rate_hz = float("nan")
        self._span = (0, 0, 0, 0)

    def add(self, block: RowBlock) -> None:
        """Take in a block of rows."""
        rows = block.level.mean(axis=2)
        count = min(KEPT_ROWS, block.rows)
        edges = np.arange(count) * block.rows // count
        sizes = np.diff(np.append(edges, block.rows))
        thin = np.add.reduceat(rows, edges, axis=1) / sizes
        self._parts.append(thin.astype(np.float32))
        first_n, first_ns = self._span[:2] if len(self._parts) > 1 else _ends(block, 0)
        last_n, last_ns = _ends(block, -1)
        self._span = (first_n, first_ns, last_n, last_ns)
        if last_ns > first_ns:
            self.frame_rate_hz = (last_n - first_n) * 1e9 / (last_ns - first_ns)

    def spectrogram(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Times (s), frequencies (Hz) and level (dB, shape frequencies × times).

        The series is the paper's: rows of all frames one after the other, as if none were missing
        between frames. Each row's own mean is taken off, and with it the picture's texture.
        """
        rows = np.concatenate(self._parts)
        series = (rows - rows.mean(axis=0)).reshape(-1).astype(np.float64)
        rate_hz = self.frame_rate_hz * rows.shape[1]
        size = int(min(WINDOW_S * rate_hz, series.size))
        step = max(int(STEP_S * rate_hz), 1)
        starts = np.arange(0, series.size - size + 1, step)
        weights = np.hanning(size)
        power = np.stack([np.abs(np.fft.rfft(series[s : s + size] * weights)) ** 2 for s in starts])
        level_db = 10.0 * np.log10(power.T / np.sum(weights) ** 2 * 4.0 + 1e-9)
        return (starts + size / 2) / rate_hz, np.fft.rfftfreq(size, 1.0 / rate_hz), level_db


def _ends(block: RowBlock, which: int) -> tuple[int, int]:
    return int(block.frame_number[which]), int(block.frame_pts_ns[which])
