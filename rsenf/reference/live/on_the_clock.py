"""Puts the seconds of a stream, of a camera or a sound card, on the wall clock.

Arrival times give the offset between the stream's clock and the wall clock. They drift apart, as
the stream's clock is off by some parts per million. When they differ by most of a sample, one
sample becomes a gap, or one of the stream's is dropped, so that each sample of the reference is
sent once.
"""

from __future__ import annotations

import numpy as np

from rsenf.messages import ReferenceBlock
from rsenf.reference.live.growing import Growing
from rsenf.timebase import ArrivalClock

# Samples by which the clocks must differ before one is dropped or inserted. More than a half, for
# hysteresis against jitter.
PART_SAMPLES = 0.75


class OnTheClock:
    """Places the samples of one stream after another on a growing reference.

    Parameters
    ----------
    growing : Growing
    """

    def __init__(self, growing: Growing) -> None:
        self._growing = growing
        self.new_stream()

    def new_stream(self) -> None:
        """Begin another stream, whose clock is unrelated to the one before."""
        self._clock = ArrivalClock()
        self._last: tuple[int, int] | None = None  # start and number of the last sample

    def note(self, pts_ns: int, arrival_ns: int) -> None:
        """Record the arrival time of data at ``pts_ns`` on the stream's clock; 0 is unknown."""
        self._clock.note(pts_ns, arrival_ns)

    def sample(self, start_ns: int, freq_hz: float, nominal_hz: float) -> list[ReferenceBlock]:
        """Add the sample that begins at ``start_ns`` on the stream's clock; return its blocks."""
        growing = self._growing
        time_ns = start_ns + (self._clock.offset_ns or 0)
        if not growing.covers(time_ns, time_ns):
            growing.begin(time_ns, nominal_hz)
        index = self._index(start_ns, (time_ns - growing.t0_ns) / growing.step_ns)
        self._last = start_ns, index
        return growing.append(np.array([index]), np.array([freq_hz]))

    def _index(self, start_ns: int, by_clock: float) -> int:
        """Count on from the last sample, unless this has drifted too far from the wall clock."""
        if self._last is None:
            return round(by_clock)
        last_ns, last = self._last
        counted = last + round((start_ns - last_ns) / self._growing.step_ns)
        return counted if abs(by_clock - counted) < PART_SAMPLES else round(by_clock)
