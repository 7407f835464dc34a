"""Presentation times of frames: exact where the stream has them, otherwise counted as inferred."""

from __future__ import annotations

from collections import deque
from fractions import Fraction

import av

from rsenf.timebase import pts_to_ns

# More packets than any decoder holds before it returns the first of their frames.
IN_FLIGHT = 256
# FFmpeg's assumption, too, for a stream without a declared rate.
ASSUMED_RATE_HZ = Fraction(25)


class FrameClock:
    """Presentation times of the frames of one stream.

    1. A frame has the presentation time stamp (PTS) that the container gave its packet.
    2. Without PTS, the n-th frame shown gets the n-th decoding time stamp (DTS), which rises from
       packet to packet, plus the last known difference of PTS and DTS. This is exact for AVI, whose
       packets are numbered at a constant rate.
    3. A raw elementary stream has no time stamps: each frame follows the one before by one period
       of the frame rate.

    FFmpeg's own guess (``genpts``) must be off: it gets the order of B frames in AVI wrong.

    Parameters
    ----------
    time_base : Fraction
        Seconds per tick.
    rate_hz : Fraction
        Frame rate, for rule 3; 0 if unknown.

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
        self._anchor_ns = 0  # last time by rule 1 or 2
        self._since_anchor = -1
        self._packets = 0
        self.from_order = 0
        self.from_rate = 0

    def expect(self, packet: av.Packet[av.VideoStream]) -> int:
        """Note a packet that is passed to the decoder; return its PTS, or else DTS, in ns."""
        if packet.dts is not None:
            self._decode_times.append(packet.dts)
        number, self._packets = self._packets, self._packets + 1
        ticks = packet.dts if packet.pts is None else packet.pts
        if ticks is None:
            return pts_to_ns(number, self._period_s)
        return pts_to_ns(ticks, self._time_base)

    def forget(self) -> None:
        """Note that a packet could not be decoded, so that no frame of it will come."""
        if self._decode_times:
            self._decode_times.popleft()
        else:
            self._since_anchor += 1

    def time_ns(self, pts: int | None) -> int:
        """Return the time of the next frame shown, in ns, from its PTS if it has one."""
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
