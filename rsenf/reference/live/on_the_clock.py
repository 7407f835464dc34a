"""Seconds of a stream, of a camera or a sound card, on the clock of the day.

Arrivals tell what lies between a stream's clock and that of the day. The two part in the long run,
as the stream's clock is some parts per million off: then a second is left as a gap, or one of the
stream's is left out, and every second of the reference is told once.
"""

from __future__ import annotations

import numpy as np

from rsenf.messages import ReferenceBlock
from rsenf.reference.live.growing import Growing
from rsenf.timebase import ArrivalClock

# Samples by which the clocks must part before one is left out or put in, so that rounding to and
# fro can't do it.
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
        """Begin another stream: its clock has nothing to do with that before."""
        self._clock = ArrivalClock()
        self._last: tuple[int, int] | None = None  # start and place of the sample told last

    def note(self, pts_ns: int, arrival_ns: int) -> None:
        """Take in that data of this time on the stream's clock arrived then; 0 is unknown."""
        self._clock.note(pts_ns, arrival_ns)

    def sample(self, start_ns: int, freq_hz: float, nominal_hz: float) -> list[ReferenceBlock]:
        """Add the sample that begins then on the stream's clock; return what it completes."""
        growing = self._growing
        time_ns = start_ns + (self._clock.offset_ns or 0)
        if not growing.covers(time_ns, time_ns):
            growing.begin(time_ns, nominal_hz)
        index = self._index(start_ns, (time_ns - growing.t0_ns) / growing.step_ns)
        self._last = start_ns, index
        return growing.append(np.array([index]), np.array([freq_hz]))

    def _index(self, start_ns: int, by_clock: float) -> int:
        """Count on from the sample before, unless that has left the clock of the day behind."""
        if self._last is None:
            return round(by_clock)
        last_ns, last = self._last
        counted = last + round((start_ns - last_ns) / self._growing.step_ns)
        return counted if abs(by_clock - counted) < PART_SAMPLES else round(by_clock)
