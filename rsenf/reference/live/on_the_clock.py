"""Seconds of a stream, of a camera or a sound card, on the clock of the day.

What lies between a stream's clock and that of the day is the least of what its messages of the last
minute show: none arrives before it was taken, some arrive without delay. The two part in the long
run, as the stream's clock is some parts per million off: then a second is left as a gap, or one of
the stream's is left out, and every second of the reference is told once.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from rsenf.messages import ReferenceBlock
from rsenf.reference.live.growing import Growing
from rsenf.timebase import NS_PER_S

CLOCK_MEMORY_NS = 60 * NS_PER_S
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
        time_ns = start_ns + self._clock.offset_ns
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


class ArrivalClock:
    """What to add to a stream's clock for the clock of the day, by when its messages arrived."""

    def __init__(self) -> None:
        self._offsets: deque[tuple[int, int]] = deque()  # stream clock and offset, rising

    def note(self, pts_ns: int, arrival_ns: int) -> None:
        """Take in that data of this time on the stream's clock arrived then; 0 is unknown."""
        offsets, offset_ns = self._offsets, arrival_ns - pts_ns
        if not arrival_ns:
            return
        while offsets and offsets[-1][1] >= offset_ns:
            offsets.pop()
        offsets.append((pts_ns, offset_ns))
        while offsets[0][0] < pts_ns - CLOCK_MEMORY_NS:
            offsets.popleft()

    @property
    def offset_ns(self) -> int:
        """The least delay of the last minute; 0 when nothing told when it arrived."""
        return self._offsets[0][1] if self._offsets else 0
