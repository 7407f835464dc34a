"""The shutter, and the times it gives to a clip's frames and to their lines.

:class:`Shutter` is the order and speed of the read-out. :class:`Clip` plans the frames: capture
time, delivery and time stamp of each. :class:`ReadOut` times a block of them: when lines are
exposed, and how far the picture is displaced.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rsenf.model.grid import FloatArray
from rsenf.model.parameters import parameter

NTSC_30 = Fraction(30000, 1001)
Int64Array = NDArray[np.int64]
# Time base of irregular stamps: microseconds, which mp4 and mov store exactly.
FINE = Fraction(1, 1_000_000)


@dataclass(frozen=True, kw_only=True)
class Shutter:
    """A rolling or global shutter.

    Times are by the camera's own clock. A line is what is exposed together: a row, or a column if
    the read-out runs along the columns, as in a phone held upright.
    """

    frame_rate: Fraction = parameter(
        NTSC_30, "frames per second of the camera's clock", low=1, high=1000
    )
    rows: int = parameter(720, "rows of a frame", low=16, high=8192)
    columns: int = parameter(1280, "columns of a frame", low=16, high=8192)
    idle_ratio: float = parameter(
        0.38, "share of the frame period in which no line is read", low=0, high=0.99
    )
    read_out: str = parameter(
        "rows",
        "rows, top to bottom; columns, left to right; or global, all at once",
        choices=("rows", "columns", "global"),
    )

    @property
    def lines(self) -> int:
        """Lines of a frame, in the order of their read-out."""
        return self.columns if self.read_out == "columns" else self.rows

    @property
    def across_px(self) -> int:
        """Pixels in a line."""
        return self.rows if self.read_out == "columns" else self.columns

    @property
    def read_out_time_s(self) -> float:
        """Time from line 0 to one past the last: ``T_ro = (1 − ρ) / F_r``; 0 if global."""
        return 0.0 if self.read_out == "global" else (1 - self.idle_ratio) / float(self.frame_rate)


@dataclass(eq=False)
class Clip:
    """The plan of all frames, which effects on frames and on delivery change."""

    frame_rate: Fraction  # nominal rate by the camera's clock, after a rate conversion if any
    start_s: FloatArray  # (captured,) start of row 0 of each captured frame, by the camera's clock
    stamp_offset_s: FloatArray  # (captured,) time stamp of each frame less the time of its slot
    number: Int64Array  # (delivered,) captured frame that each delivered one is; never falling
    slot: Int64Array  # (delivered,) position on the clip's time axis, in frame periods
    clock_factor: float = 1.0  # camera seconds per true second
    # (delivered,) share of the previous captured frame in each delivered one; None for no blending
    blend: FloatArray | None = None

    @classmethod
    def regular(cls, frame_rate: Fraction, frames: int) -> Clip:
        """Plan frames one period apart, all of which are delivered.

        >>> Clip.regular(Fraction(25), 3).stamp_s().tolist()
        [0.0, 0.04, 0.08]
        """
        number = np.arange(frames)
        start_s = number / float(frame_rate)
        return cls(frame_rate, start_s, np.zeros(frames), number, number.copy())

    @property
    def irregular(self) -> bool:
        """Whether any captured frame begins off its nominal time."""
        return not np.array_equal(
            self.start_s, np.arange(self.start_s.size) / float(self.frame_rate)
        )

    @property
    def time_base(self) -> Fraction:
        """Seconds per unit of :meth:`pts`."""
        return FINE if self.stamp_offset_s.any() else 1 / self.frame_rate

    def stamp_s(self) -> FloatArray:
        """Presentation time of each delivered frame, seconds."""
        return np.asarray(self.slot / float(self.frame_rate) + self.stamp_offset_s[self.number])

    def pts(self) -> Int64Array:
        """Presentation time of each delivered frame, in units of the time base."""
        if self.time_base is not FINE:
            return self.slot
        return np.round(self.stamp_s() / float(FINE)).astype(np.int64)

    def dropped(self) -> Int64Array:
        """Numbers of the captured frames that aren't delivered."""
        lost = np.ones(self.start_s.size, bool)
        lost[self.number] = False
        return np.flatnonzero(lost)

    def duplicated(self) -> Int64Array:
        """Numbers of the captured frames that are delivered again, once for each repetition."""
        again = np.diff(self.number) == 0
        return np.asarray(self.number[1:][again])


@dataclass(eq=False)
class ReadOut:
    """A block of frames as the shutter takes them, with times by the camera's clock."""

    number: Int64Array  # (frames,) number of each captured frame
    start_s: FloatArray  # (frames,) start of each frame's first line
    line_s: FloatArray  # (frames, lines) start of each line's exposure after its frame's start
    # time from the first line to one past the last, which an idle estimator should find
    read_out_s: float
    exposure_s: float  # exposure of a line
    # (frames, lines) displacement of the picture in the lines' order; or (frames, 1)
    shift_px: FloatArray

    @classmethod
    def of(cls, shutter: Shutter, number: Int64Array, start_s: FloatArray) -> ReadOut:
        """Return the read-out of a plain shutter: ``l · T_ro / L``, instantaneous exposure."""
        frames, lines = number.size, shutter.lines
        line_s = np.arange(lines) * (shutter.read_out_time_s / lines)
        return cls(
            number=number,
            start_s=start_s,
            line_s=np.repeat(line_s[None], frames, axis=0),
            read_out_s=shutter.read_out_time_s,
            exposure_s=0.0,
            shift_px=np.zeros((frames, 1)),
        )
