"""When each frame was taken, by the stream: exact, or said not to be."""

from __future__ import annotations

from collections import deque
from fractions import Fraction

import av

from rsenf.timebase import pts_to_ns

# More packets than any decoder keeps before it gives out the first of their frames.
IN_FLIGHT = 256
# What FFmpeg assumes, too, of a stream that declares no rate.
ASSUMED_RATE_HZ = Fraction(25)


class FrameClock:
    """Presentation times of the frames of one stream.

    1. A frame has the presentation time (PTS) that the container gave its packet.
    2. Where there is none, the n-th frame shown takes the n-th decoding time, which rises from
       packet to packet, plus the delay between the two seen last. This is exact for AVI, whose
       packets are numbered at a constant rate.
    3. A bare elementary stream has no times at all: a frame then comes one period of the rate after
       the one before.

    FFmpeg's own guess (``genpts``) must be off: in AVI with B frames it gets their order wrong.

    Parameters
    ----------
    time_base : Fraction
        Seconds per tick.
    rate_hz : Fraction
        Frame rate, for rule 3; 0 is unknown.

    Attributes
    ----------
    from_order, from_rate : int
        Frames timed by rules 2 and 3.
    """

    def __init__(self, time_base: Fraction, rate_hz: Fraction) -> None:
        self._time_base = time_base
        self._period_s = 1 / (rate_hz or ASSUMED_RATE_HZ)
        self._decode_times: deque[int] = deque(maxlen=IN_FLIGHT)
        self._delay = 0
        self._anchor_ns = 0  # last time that rule 1 or 2 gave
        self._since_anchor = -1
        self._packets = 0
        self.from_order = 0
        self.from_rate = 0

    def expect(self, packet: av.Packet[av.VideoStream]) -> int:
        """Take note of a packet that goes into the decoder; return its time in ns.

        It is the presentation time, or the decoding time where there is none.
        """
        if packet.dts is not None:
            self._decode_times.append(packet.dts)
        number, self._packets = self._packets, self._packets + 1
        ticks = packet.dts if packet.pts is None else packet.pts
        if ticks is None:
            return pts_to_ns(number, self._period_s)
        return pts_to_ns(ticks, self._time_base)

    def forget(self) -> None:
        """Take note that a packet gave no frame."""
        if self._decode_times:
            self._decode_times.popleft()
        else:
            self._since_anchor += 1

    def time_ns(self, pts: int | None) -> int:
        """Time of the next frame shown, in ns, by its PTS or in its absence."""
        decode_time = self._decode_times.popleft() if self._decode_times else None
        if pts is not None:
            if decode_time is not None:
                self._delay = pts - decode_time
            return self._anchor(pts)
        if decode_time is not None:
            self.from_order += 1
            return self._anchor(decode_time + self._delay)
        self.from_rate += 1
        self._since_anchor += 1
        return self._anchor_ns + pts_to_ns(self._since_anchor, self._period_s)

    def _anchor(self, pts: int) -> int:
        self._anchor_ns, self._since_anchor = pts_to_ns(pts, self._time_base), 0
        return self._anchor_ns
