"""Every frame of a clip: when it was captured, whether it came, and what its stamp says."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rsenf.model.grid import FloatArray

Int64Array = NDArray[np.int64]

# Where stamps aren't whole frame periods: microseconds, which mp4 and mov keep exactly.
FINE = Fraction(1, 1_000_000)


@dataclass(eq=False)
class Clip:
    """A plan of all frames, which effects on frames and on delivery change.

    Attributes
    ----------
    frame_rate : Fraction
        Nominal rate of the camera's clock, or the one that its frames were converted to.
    start_s : ndarray of float64 (captured,)
        Camera's clock when row 0 of each captured frame begins.
    stamp_offset_s : ndarray of float64 (captured,)
        What each frame's stamp shows beyond the time of its slot.
    number : ndarray of int64 (delivered,)
        Which captured frame each delivered one is; never falling.
    slot : ndarray of int64 (delivered,)
        Its place on the clip's time axis, in frame periods.
    clock_factor : float
        Camera seconds in a true second.
    blend : ndarray of float64 (delivered,) or None
        Share of each delivered frame that the one captured before it has; None is nothing.
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
        """Plan frames one period apart, all of which arrive."""
        number = np.arange(frames)
        start_s = number / float(frame_rate)
        return cls(frame_rate, start_s, np.zeros(frames), number, number.copy())

    @property
    def irregular(self) -> bool:
        """Whether any frame begins off its period."""
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
        """Numbers of the captured frames that never arrive."""
        lost = np.ones(self.start_s.size, bool)
        lost[self.number] = False
        return np.flatnonzero(lost)

    def duplicated(self) -> Int64Array:
        """Numbers of the captured frames that arrive again, once for each time."""
        again = np.diff(self.number) == 0
        return np.asarray(self.number[1:][again])
