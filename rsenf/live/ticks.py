"""Time base of liveness detection: one tick for each second of pictures, and its UTC.

Each verdict uses the messages up to a fixed time before its tick, in whatever order different
processes sent them. Therefore live, replayed and file input give the same verdicts.

The UTC of a picture is estimated from its arrival. The stream's clock has an unknown offset, and
arrivals have jitter, so the smallest offset of the last minute is used (minimum filter). The
remaining delay is part of the lag that the flicker tells.
"""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.live.picture import PictureFacts, RepeatDetector
from rsenf.live.settings import LiveSettings
from rsenf.messages import Header, RowBlock
from rsenf.timebase import NS_PER_S, ArrivalClock, seconds


class HostTime:
    """Offset from a stream's clock to UTC.

    Parameters
    ----------
    start_utc_ns : int
        Time of the first picture for recordings and simulations; 0 to use arrival times, or else
        the camera's clock.

    Attributes
    ----------
    offset_ns : int or None
        UTC minus the stream's clock; None if unknown.
    """

    def __init__(self, start_utc_ns: int = 0) -> None:
        self.start_ns = start_utc_ns
        self.offset_ns: int | None = None
        self._arrivals = ArrivalClock()
        self._begun_ns: int | None = None  # arrival of the first picture of all

    def begin(self, header: Header) -> None:
        """Begin an epoch, in which the stream's clock may have another offset."""
        self._arrivals = ArrivalClock()
        self.offset_ns = None
        if not self.start_ns:
            return
        if self._begun_ns is None:
            self._begun_ns = header.arrival_time_ns
        since_ns = header.arrival_time_ns - self._begun_ns
        self.offset_ns = self.start_ns + since_ns - header.pts_ns

    def add(self, header: Header) -> None:
        """Note an arrival time, or else a time of the camera's clock."""
        if self.start_ns:
            return
        self._arrivals.note(header.pts_ns, header.arrival_time_ns or header.camera_time_ns)
        self.offset_ns = self._arrivals.offset_ns


STEP_NS = 5 * NS_PER_S  # the stream's clock was set if it is off by more


@dataclass(frozen=True)
class Tick:
    """A completed second of pictures.

    Attributes
    ----------
    header : Header
        Header of the block that completed it.
    pts_ns : int
        Stream clock of its last frame.
    first_pts_ns : int
        Stream clock of the epoch's first frame.
    offset_ns : int or None
        UTC minus the stream's clock; None if unknown.
    facts : PictureFacts
    part : int
        Counts the starts of the stream's clock, which may also be set within an epoch.
    silent_s : float
        Time without pictures just before; 0 if below ``lost_s``.
    dropped : int
        Frames just before that came, and that this host dropped, if they last for ``lost_s``.
    """

    header: Header
    pts_ns: int
    first_pts_ns: int
    offset_ns: int | None
    facts: PictureFacts
    part: int
    silent_s: float = 0.0
    dropped: int = 0

    @property
    def run(self) -> tuple[str, int]:
        """Run and epoch."""
        return self.header.run_id, self.header.epoch

    @property
    def utc_ns(self) -> int:
        """UTC of its last frame; 0 if unknown."""
        return 0 if self.offset_ns is None else self.pts_ns + self.offset_ns


class Ticker:
    """Converts row blocks to ticks.

    Attributes
    ----------
    run : (str, int) or None
        Run and epoch of the newest block.
    """

    def __init__(self, settings: LiveSettings, start_utc_ns: int) -> None:
        self._settings = settings
        self._time = HostTime(start_utc_ns)
        self._picture = RepeatDetector(settings.frozen_s, settings.loop_s)
        self.run: tuple[str, int] | None = None
        self._first_ns = self._next_ns = 0
        self._last: tuple[int, int] | None = None  # stream clock and arrival of the last frame
        self._frame = -1  # number of the last frame
        self._period_ns = 0  # of the frames
        self._silent_s, self._dropped = 0.0, 0
        self._part = 0

    def add(self, block: RowBlock) -> Tick | None:
        """Take a block; return the tick that it completes, or None."""
        if not block.frames:
            return None
        header, now_ns = block.header, int(block.frame_pts_ns[-1])
        was_set = self._note_gap(block)
        if (header.run_id, header.epoch) != self.run or was_set:
            self.run = header.run_id, header.epoch
            self._first_ns = self._next_ns = int(block.frame_pts_ns[0])
            self._part += 1
            self._time.begin(header)
            self._picture = RepeatDetector(self._settings.frozen_s, self._settings.loop_s)
        self._time.add(header)
        self._picture.add(block)
        lasts_ns = now_ns - int(block.frame_pts_ns[0])
        self._last = now_ns, header.arrival_time_ns and header.arrival_time_ns + lasts_ns
        self._frame = int(block.frame_number[-1])
        if block.frames > 1:
            self._period_ns = lasts_ns // max(self._frame - int(block.frame_number[0]), 1)
        if now_ns < self._next_ns:
            return None
        self._next_ns = now_ns + NS_PER_S - (now_ns - self._first_ns) % NS_PER_S
        silent_s, dropped = self._silent_s, self._dropped
        self._silent_s, self._dropped = 0.0, 0
        offset_ns, facts = self._time.offset_ns, self._picture.facts
        return Tick(header, now_ns, self._first_ns, offset_ns, facts, self._part, silent_s, dropped)

    def _note_gap(self, block: RowBlock) -> bool:
        """Note the time without pictures before a block; return whether the clock was set.

        The stream's clock and the arrival must both have a gap, where both are known: a camera
        may set its clock ahead, and a network may hold pictures back, without losing any. Frames
        that were numbered in between had come: this host has dropped them, and only the rest of the
        gap is silence.
        """
        if self._last is None:
            return False
        header, (last_ns, last_arrival_ns) = block.header, self._last
        gap_ns = int(block.frame_pts_ns[0]) - last_ns
        is_known = bool(last_arrival_ns and header.arrival_time_ns)
        arrived_ns = header.arrival_time_ns - last_arrival_ns if is_known else 0
        if (header.run_id, header.epoch) != self.run:
            self._note_silence(arrived_ns)
            return False
        is_live = is_known and not self._time.start_ns
        silent_ns = min(gap_ns, arrived_ns) if is_live else gap_ns
        dropped = max(int(block.frame_number[0]) - self._frame - 1, 0)
        self._note_silence(silent_ns - dropped * self._period_ns)
        if dropped and seconds(silent_ns) > self._settings.lost_s and not self._silent_s:
            self._dropped += dropped
        return gap_ns < -STEP_NS or (is_live and gap_ns > max(arrived_ns, 0) + STEP_NS)

    def _note_silence(self, silent_ns: int) -> None:
        if seconds(silent_ns) > self._settings.lost_s:
            self._silent_s = seconds(silent_ns)
