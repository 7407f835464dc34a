"""The plan of a clip's frames: capture time, delivery and time stamp of each."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rsenf.model.grid import FloatArray

Int64Array = NDArray[np.int64]

# Time base of irregular stamps: microseconds, which mp4 and mov store exactly.
FINE = Fraction(1, 1_000_000)


@dataclass(eq=False)
class Clip:
    """The plan of all frames, which effects on frames and on delivery change.

    Attributes
    ----------
    frame_rate : Fraction
        Nominal rate by the camera's clock, after a rate conversion if any.
    start_s : ndarray of float64 (captured,)
        Start of row 0 of each captured frame, by the camera's clock.
    stamp_offset_s : ndarray of float64 (captured,)
        Time stamp of each frame less the time of its slot.
    number : ndarray of int64 (delivered,)
        Captured frame that each delivered one is; never falling.
    slot : ndarray of int64 (delivered,)
        Position on the clip's time axis, in frame periods.
    clock_factor : float
        Camera seconds per true second.
    blend : ndarray of float64 (delivered,) or None
        Share of the previous captured frame in each delivered one; None for no blending.
    """

    frame_rate: Fraction
    start_s: FloatArray
    stamp_offset_s: FloatArray
    number: Int64Array
    slot: Int64Array
    clock_factor: float = 1.0
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
