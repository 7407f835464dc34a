"""Spectrogram about the grid's nominal frequency, one column a second, directly from the rows.

Each frame's rows, less their running mean, are projected onto the flicker's phase ramp down the
rows, which separates the aliased lines. The resulting complex series at the frame rate is
transformed over the last 20 s (Hann window) at few frequencies. This is independent of the ENF
estimator whose values are drawn beside it.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from rsenf.dashboard.row_strip import row_level
from rsenf.dashboard.tail import BLANK, Columns
from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S

SECONDS = 600  # columns of the image
WINDOW_S = 20.0
BINS = 81
HALF_WIDTH_HZ = 0.2  # range of the ENF about its nominal value
SPAN_DB = 50.0  # range of power above the median
USUAL_IDLE = 0.25  # idle ratio before it has been estimated
MOST_FRAMES = 4800  # 20 s at 240 frames/s


class Spectrogram:
    """Columns of power about ``2·nominal_hz``, one a second.

    Attributes
    ----------
    columns : Columns
        From the highest frequency down; 1 at the median and below, 255 at 50 dB above it.
    nominal_hz : float
        50 or 60; may be set.
    read_out_ratio : float
        Read-out time over frame period, negative from bottom to top; may be set.
    centre_pts_ns : int
        Stream clock at the centre of the newest window.
    """

    def __init__(self) -> None:
        self.columns = Columns(SECONDS)
        self.nominal_hz = 50.0
        self.read_out_ratio = 1.0 - USUAL_IDLE
        self.centre_pts_ns = 0
        self._series: deque[tuple[int, complex]] = deque(maxlen=MOST_FRAMES)
        self._base: NDArray[np.float64] | None = None
        self._drawn_ns = 0

    def begin_anew(self) -> None:
        """Discard the series, because the stream's clock was reset."""
        self._series.clear()
        self._drawn_ns = 0

    def update(self, block: RowBlock) -> None:
        """Take a block, and add a column for each second that it completes."""
        level = row_level(block)
        if not level.size:
            return
        mean = level.mean(axis=0)
        if self._base is None or self._base.size != mean.size:
            self._base = mean
        self._base = self._base + 0.02 * (mean - self._base)
        amplitude = (level - self._base) @ self._ramp(block)
        pts_ns = block.frame_pts_ns.tolist()
        silence_ns = pts_ns[0] - self._series[-1][0] if self._series else 0
        if self._series and silence_ns <= 0:
            self.begin_anew()
        self._series.extend(zip(pts_ns, amplitude.tolist(), strict=True))
        self._draw(pts_ns[-1], has_gap=silence_ns > NS_PER_S)

    def _ramp(self, block: RowBlock) -> NDArray[np.complex128]:
        """Conjugate phase ramp of the flicker down the rows of a frame."""
        pts_ns = block.frame_pts_ns
        frame_s = float(np.median(np.diff(pts_ns))) / NS_PER_S if block.frames > 1 else 1 / 30
        row_s = np.arange(block.rows) * self.read_out_ratio * frame_s / block.rows
        return np.asarray(np.exp(-4j * np.pi * self.nominal_hz * row_s))

    def _draw(self, now_ns: int, *, has_gap: bool) -> None:
        if not self._drawn_ns:
            self._drawn_ns = now_ns
        due = (now_ns - self._drawn_ns) // NS_PER_S
        if due < 1:
            return
        self._drawn_ns += due * NS_PER_S
        since_ns = now_ns - round(WINDOW_S * NS_PER_S)
        while self._series and self._series[0][0] < since_ns:
            self._series.popleft()
        self.centre_pts_ns = now_ns - round(WINDOW_S * NS_PER_S / 2)
        if self._series[0][0] - since_ns > NS_PER_S:
            self.columns.add_blank(int(due))  # the window isn't full yet
            return
        if has_gap:
            self.columns.add_blank(int(due) - 1)
            due = 1
        # A block may be slightly longer than a second, and thus complete two.
        self.columns.add(np.repeat(self._column()[None], min(due, SECONDS), axis=0))

    def _column(self) -> NDArray[np.uint8]:
        t_ns = np.array([t for t, _ in self._series], np.int64)
        t_s = (t_ns - t_ns[0]) / NS_PER_S
        values = np.array([value for _, value in self._series])
        window = 0.5 - 0.5 * np.cos(2 * np.pi * (t_s + 1e-3) / (t_s[-1] + 2e-3))
        enf_hz = self.nominal_hz + np.linspace(HALF_WIDTH_HZ, -HALF_WIDTH_HZ, BINS)
        turning = np.exp(-4j * np.pi * enf_hz[:, None] * t_s)
        power = np.abs(turning @ (window * values)) ** 2
        ratio = power / max(float(np.median(power)), 1e-30)
        shown = 255.0 / SPAN_DB * 10.0 * np.log10(np.maximum(ratio, 1e-3))
        return np.asarray(np.clip(np.rint(shown), BLANK + 1, 255).astype(np.uint8))
