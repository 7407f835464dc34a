"""Images that grow by columns: the rows of the last frames, and a spectrogram.

The first shows the rolling bands. The second is about the grid's nominal frequency, one column a
second, directly from the rows: each frame's rows, less their running mean, are projected onto the
flicker's phase ramp down the rows, which separates the aliased lines. The resulting complex series
at the frame rate is transformed over the last 20 s (Hann window) at few frequencies. This is
independent of the ENF estimator whose values are drawn beside it.
"""

from __future__ import annotations

import base64
import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S

BLANK = 0  # level of a column without measurement


class SpectrumColumns:
    """Columns of bytes, the newest last.

    Parameters
    ----------
    keep : int
        Number of columns kept.

    Attributes
    ----------
    total : int
        Number of columns since the last reset.
    begun : int
        Number of resets, which happen when the image's height changes.
    """

    def __init__(self, keep: int) -> None:
        self.total = self.begun = 0
        self.height = 0
        self._kept: deque[bytes] = deque(maxlen=keep)

    def add(self, columns: NDArray[np.uint8]) -> None:
        """Add columns, an array of shape (columns, height)."""
        if columns.shape[1] != self.height:
            self.height, self.total = int(columns.shape[1]), 0
            self.begun += 1
            self._kept.clear()
        self._kept.extend(column.tobytes() for column in columns)
        self.total += len(columns)

    def add_blank(self, count: int) -> None:
        """Add columns without measurement."""
        if self.height and count > 0:
            count = min(count, self._kept.maxlen or count)
            self.add(np.full((count, self.height), BLANK, np.uint8))

    def since(self, seen: tuple[int, int]) -> dict[str, Any]:
        """Return the columns after those seen, for JSON; ``seen`` as in the property."""
        begun, total = seen
        fresh = self.total - total if begun == self.begun else self.total
        fresh = min(fresh, len(self._kept))
        # Index from the end: access to the middle of a deque is slow, and few columns are new.
        newest = [self._kept[-1 - back] for back in range(fresh)][::-1]
        return {
            "reset": begun != self.begun,
            "height": self.height,
            "columns": fresh,
            "keep": self._kept.maxlen,
            "data": base64.b64encode(b"".join(newest)).decode(),
        }

    @property
    def seen(self) -> tuple[int, int]:
        """Resets and columns up to now: the state of a viewer who has seen everything."""
        return self.begun, self.total


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
    columns : SpectrumColumns
        One for each frame, from the first row down; 1 to 255, 128 for a row's mean.
    rms_level : float
        Recent root mean square deviation, in 8-bit levels.
    frame_rate_hz : float
        Frame rate of the latest block.
    """

    def __init__(self) -> None:
        self.columns = SpectrumColumns(FRAMES)
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
    columns : SpectrumColumns
        From the highest frequency down; 1 at the median and below, 255 at 50 dB above it.
    nominal_hz : float
        50 or 60; may be set.
    read_out_ratio : float
        Read-out time over frame period, negative from bottom to top; may be set.
    centre_pts_ns : int
        Stream clock at the centre of the newest window.
    """

    def __init__(self) -> None:
        self.columns = SpectrumColumns(SECONDS)
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
