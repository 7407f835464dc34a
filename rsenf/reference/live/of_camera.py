"""Another camera as the reference: its ENF estimates on this host's clock, second by second.

Estimates are timed by the camera's stream, a reference by the clock of the day. What lies between
the two is the least of what the messages of the last minute show: none arrives before it was
filmed, some arrive without delay. The two part in the long run, as the camera's clock is some
parts per million off: then a second is left as a gap, or one of the camera's is left out, and
every second of the reference is told once.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from rsenf.messages import EnfEstimate, ReferenceBlock, RowBlock
from rsenf.reference.live.growing import Growing
from rsenf.timebase import NS_PER_S

MAX_STD_HZ = 0.005  # a quarter of the grid's own variation: what is less certain is a gap
CLOCK_MEMORY_NS = 60 * NS_PER_S
# Samples by which the clocks must part before a second is left out or put in, so that rounding
# to and fro can't do it; and by which they must before the clock of this host has been set.
PART_SAMPLES, SET_SAMPLES = 0.75, 3.0


class CameraReference:
    """From a camera's row blocks and estimates to a reference. A :class:`rsenf.stage.Stage`.

    Row blocks only tell when their frames arrived; without them the estimates do, later.

    Parameters
    ----------
    grid : str
        What to call the reference.
    step_s : float
        Time between samples; the hop of the camera's estimates.
    run_id : str
        Identity of the run.
    """

    def __init__(self, grid: str, step_s: float = 1.0, run_id: str = "") -> None:
        self._growing = Growing(grid, step_s, run_id)
        self._clock = ArrivalClock()
        self._stream: tuple[str, int] | None = None
        self._last_pts_ns = 0  # start of the sample told last, on the stream's clock
        self._last_index = 0

    def update(self, message: EnfEstimate | RowBlock) -> list[ReferenceBlock]:
        """Take a message of the camera; return the samples that it completes."""
        header = message.header
        if (header.run_id, header.epoch) != self._stream:
            self._stream = header.run_id, header.epoch
            self._clock = ArrivalClock()
            self._last_index = -1
        if isinstance(message, RowBlock):
            self._clock.note(header.pts_ns, header.arrival_time_ns)
            return []
        if message.rank != 0:
            return []
        self._clock.note(message.end_pts_ns, header.arrival_time_ns)
        return self._sample(message)

    def flush(self) -> list[ReferenceBlock]:
        """Return nothing: each sample is told when it is known."""
        return []

    def _sample(self, estimate: EnfEstimate) -> list[ReferenceBlock]:
        growing = self._growing
        # A sample is centred where its estimate is, however long that one's window.
        start_ns = (estimate.start_pts_ns + estimate.end_pts_ns - growing.step_ns) // 2
        time_ns = start_ns + self._clock.offset_ns
        if not growing.begun:
            if not np.isfinite(estimate.nominal_hz):
                return []
            growing.begin(time_ns, estimate.nominal_hz)
        index = self._index(start_ns, time_ns)
        if self._was_set(index, time_ns):
            growing.begin(time_ns, growing.nominal_hz)
            index = 0
        self._last_pts_ns, self._last_index = start_ns, index
        return growing.append(np.array([index]), np.array([_frequency_hz(estimate)]))

    def _index(self, start_ns: int, time_ns: int) -> int:
        """Count on from the sample before, unless that has left the clock of the day behind."""
        growing = self._growing
        by_clock = (time_ns - growing.t0_ns) / growing.step_ns
        if self._last_index < 0:
            return round(by_clock)
        counted = self._last_index + round((start_ns - self._last_pts_ns) / growing.step_ns)
        return counted if abs(by_clock - counted) < PART_SAMPLES else round(by_clock)

    def _was_set(self, index: int, time_ns: int) -> bool:
        """Whether this host's clock was set back, or has gone on far beyond any gap."""
        growing = self._growing
        return index < growing.next - SET_SAMPLES or index > growing.next + growing.max_gap


class ArrivalClock:
    """What to add to a stream's clock for the clock of the day, by when its messages arrived."""

    def __init__(self) -> None:
        self._offsets: deque[tuple[int, int]] = deque()  # stream clock and offset, rising

    def note(self, pts_ns: int, arrival_ns: int) -> None:
        """Take in that data of this time on the stream's clock arrived then."""
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


def _frequency_hz(estimate: EnfEstimate) -> float:
    good = estimate.usable and estimate.enf_var_hz2 <= MAX_STD_HZ**2
    return estimate.enf_hz if good else float("nan")
