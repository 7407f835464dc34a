"""The order of a recording's messages: sequence numbers, and log times.

Sequence numbers tell which messages of a topic are new, repeated or missed. Log times map stream
time to the wall clock: a file may be processed ten times faster than real time. To keep video, rows
and estimates aligned at the stream's own speed, a message's log time is the arrival of its stream's
first data plus the stream time since then. A stream that runs in real time, as a camera's, is
realigned to the wall clock when the two differ, because the clock was set or one of them runs fast.
Both continue from one file of a recording to the next.
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from rsenf.messages import (
    Frame,
    Header,
    Health,
    IdleEstimate,
    Mark,
    MatchResult,
    ReferenceBlock,
    RowBlock,
    VideoPacket,
)
from rsenf.timebase import NS_PER_S

KEPT_STREAMS = 32
RECENT_NS = 600 * NS_PER_S  # what is older isn't sent again: a clock was set back
KEPT_GAPS = 4096
_COUNT = re.compile(r"-?[0-9]{1,19}")
LATEST_NS = (1 << 64) - 1
REFERENCE = "reference/"
# These arrive together with their data; others cover an interval, and arrive at its end.
MOMENTS = (Frame, VideoPacket, RowBlock)
# These refer to their whole stream so far: their stream time is always that of its first frame.
OF_ALL_SO_FAR = (IdleEstimate, MatchResult)
# A stream is realigned to a clock that differs by more than FAR_NS, after running in step with it
# for PACE_NS. A file that happens to be processed at nearly real time doesn't run in step.
FAR_NS, PACE_NS = 1_000_000_000, 30_000_000_000


class Numbers:
    """A set of integers, stored as ranges ``[start, stop)``.

    If there are too many gaps, the oldest are counted and then treated as filled.

    Parameters
    ----------
    stop : int
        At first, the set has all numbers from 0 up to this one.

    Examples
    --------
    >>> numbers = Numbers()
    >>> [numbers.add(n) for n in (3, 4, 7, 3)], numbers.missing(2), numbers.holes(2)
    ([True, True, True, False], 3, [range(2, 3), range(5, 7)])
    """

    def __init__(self, stop: int = 0) -> None:
        self._starts = [0] if stop else []
        self._stops = [stop] if stop else []
        self._forgotten = 0

    def add(self, number: int) -> bool:
        """Add a number; return whether it is new."""
        starts, stops = self._starts, self._stops
        at = bisect.bisect_right(starts, number)  # ranges before `at` start at or below it
        if at and number < stops[at - 1]:
            return False
        joins_left = at > 0 and stops[at - 1] == number
        joins_right = at < len(starts) and starts[at] == number + 1
        if joins_left and joins_right:
            stops[at - 1] = stops.pop(at)
            starts.pop(at)
        elif joins_left:
            stops[at - 1] = number + 1
        elif joins_right:
            starts[at] = number
        else:
            starts.insert(at, number)
            stops.insert(at, number + 1)
            if len(starts) > KEPT_GAPS + 1:
                self._forgotten += starts.pop(1) - stops.pop(0)
        return True

    @property
    def first(self) -> int:
        """Smallest number in the set."""
        return self._starts[0]

    def missing(self, start: int) -> int:
        """Count the numbers from ``start`` to the largest that aren't in the set."""
        held = sum(stop - begin for begin, stop in zip(self._starts, self._stops, strict=True))
        return self._stops[-1] - min(start, self.first) - held + self._forgotten

    def holes(self, start: int) -> list[range]:
        """Return the ranges from ``start`` to the largest number that aren't in the set."""
        ends = [min(start, self.first), *self._stops[:-1]]
        return [range(*hole) for hole in zip(ends, self._starts, strict=True) if hole[0] < hole[1]]


def count_of(text: str | None) -> int | None:
    """Parse a count from metadata; None if absent or invalid, as metadata has no checksum."""
    return int(text) if text is not None and _COUNT.fullmatch(text) else None


class MessagePlace(NamedTuple):
    """A message's place in its topic."""

    run_id: str
    epoch: int
    seq: int

    @classmethod
    def of(cls, header: Header) -> MessagePlace:
        """Return the place of the message with this header."""
        return cls(header.run_id, header.epoch, header.seq)

    @classmethod
    def read(cls, text: str) -> MessagePlace:
        """Parse the result of ``str``.

        Raises
        ------
        ValueError
            When the text is no place.
        """
        seq_text, epoch_text, run_id = text.split(" ", 2)
        seq, epoch = count_of(seq_text), count_of(epoch_text)
        if seq is None or epoch is None or min(seq, epoch) < 0:
            raise ValueError(f"no place: {text!r}")
        return cls(run_id, epoch, seq)

    def __str__(self) -> str:
        return f"{self.seq} {self.epoch} {self.run_id}"


@dataclass
class TopicTally:
    """Counts of one topic in one file."""

    messages: int = 0  # messages taken
    duplicates: int = 0  # messages that had arrived before
    # first number received of the stream that was running when the recording began; earlier numbers
    # don't count as missed. In a file that continues another, the next number
    joined_at: int = 0
    # range of the file: the lowest number of the first stream, and the highest of the last one
    first: MessagePlace | None = None
    last: MessagePlace | None = None
    _settled: int = 0  # missed messages of streams that are no longer stored
    _streams: dict[tuple[str, int], Numbers] = field(default_factory=dict)
    _joined: tuple[str, int] | None = None
    _goes_on: bool = False
    # until a message is new: arrival before which others of unknown streams aren't
    _since_ns: int = 0

    @classmethod
    def after(cls, last: Header) -> TopicTally:
        """Return the tally of a file to follow a message, up to which nothing sent is new."""
        stream = (last.run_id, last.epoch)
        return cls(
            joined_at=last.seq + 1,
            _streams={stream: Numbers(last.seq + 1)},
            _joined=stream,
            _goes_on=True,
            _since_ns=last.arrival_time_ns,
        )

    def next_file(self) -> TopicTally:
        """Return the tally of a file that continues this one.

        It knows the numbers received so far. If one that was missed here arrives there, ``missed``
        decreases there, so that the sum over all files is correct.
        """
        return TopicTally(
            joined_at=self.last.seq + 1 if self.last else self.joined_at,
            _settled=self._settled - self.missed,
            _streams=self._streams,
            _joined=self._joined,
            _goes_on=True,
            _since_ns=self._since_ns,
        )

    def take(self, header: Header) -> bool:
        """Count a message; return whether it is new."""
        stream = (header.run_id, header.epoch)
        before_ns = self._since_ns - header.arrival_time_ns
        if stream not in self._streams and 0 < before_ns < RECENT_NS:
            self.duplicates += 1
            return False
        if self._joined is None:
            self._joined = stream
        numbers = self._streams.setdefault(stream, Numbers())
        new = numbers.add(header.seq)
        if stream == self._joined and not self._goes_on:
            self.joined_at = numbers.first
        if new:
            self._since_ns = 0
            self._extend(MessagePlace.of(header))
        self.messages += new
        self.duplicates += not new
        if len(self._streams) > KEPT_STREAMS:
            oldest = next(iter(self._streams))
            self._settled += self._missed_in(oldest, self._streams.pop(oldest))
        return new

    def _extend(self, place: MessagePlace) -> None:
        if self.first is None or (place[:2] == self.first[:2] and place < self.first):
            self.first = place
        if self.last is None or place[:2] != self.last[:2] or place > self.last:
            self.last = place

    @property
    def missed(self) -> int:
        """Number of messages that never arrived."""
        return self._settled + sum(self._missed_in(*item) for item in self._streams.items())

    def _missed_in(self, stream: tuple[str, int], numbers: Numbers) -> int:
        return numbers.missing(numbers.first if stream == self._joined else 0)


class Timeline:
    """Assigns log times to messages.

    Parameters
    ----------
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    """

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        self._clock_ns = clock_ns
        self._sources: dict[str, dict[tuple[str, int], _Stream]] = {}

    def log_time_ns(self, cls: type[Any], header: Header) -> int:
        """Return the log time of a message, from 0 to 2⁶⁴ − 1."""
        if cls in (Health, ReferenceBlock) or header.source.startswith(REFERENCE):
            return _bounded(self._clock_ns())
        streams = self._sources.setdefault(header.source, {})
        stream = streams.get((header.run_id, header.epoch))
        arrival_ns = self.arrival_ns(header)
        if header.mark != Mark.DATA:
            # A mark has no stream time: it gets the latest log time of its stream.
            return stream.latest_ns if stream else arrival_ns
        if stream is None:
            if cls in OF_ALL_SO_FAR:
                return arrival_ns
            stream = streams[header.run_id, header.epoch] = _Stream(header.pts_ns, arrival_ns)
            if len(streams) > KEPT_STREAMS:
                del streams[next(iter(streams))]
        if cls in MOMENTS:
            stream.follow(header.pts_ns, arrival_ns)
        return stream.log_time_ns(header.pts_ns)

    def arrival_ns(self, header: Header) -> int:
        """Return the arrival time of the message's data; now if unknown."""
        return _bounded(header.arrival_time_ns or self._clock_ns())


class _Stream:
    """Offset from stream time to log time, and the latest log time so far."""

    def __init__(self, pts_ns: int, arrival_ns: int) -> None:
        self.latest_ns = 0
        self._offset_ns = self._tried_ns = arrival_ns - pts_ns
        self._tried_since_ns = pts_ns

    def log_time_ns(self, pts_ns: int) -> int:
        time_ns = _bounded(self._offset_ns + pts_ns)
        self.latest_ns = max(time_ns, self.latest_ns)
        return time_ns

    def follow(self, pts_ns: int, arrival_ns: int) -> None:
        """Realign to the clock, if it has run in step with the stream at a different offset."""
        offset_ns = arrival_ns - pts_ns
        if abs(offset_ns - self._tried_ns) > FAR_NS:
            self._tried_ns, self._tried_since_ns = offset_ns, pts_ns
        is_far = abs(self._tried_ns - self._offset_ns) > FAR_NS
        if is_far and pts_ns - self._tried_since_ns >= PACE_NS:
            self._offset_ns, self.latest_ns = self._tried_ns, 0


def _bounded(time_ns: int) -> int:
    return min(max(time_ns, 0), LATEST_NS)


@dataclass
class Continuity:
    """A common time line of all files, and the sequence numbers received."""

    timeline: Timeline  # continues log times without a jump
    tallies: dict[str, TopicTally] = field(default_factory=dict)  # by topic, for the current file
    # Of each topic, the last message that another process recorded.
    resumed: dict[str, Header] = field(default_factory=dict)

    def tally(self, topic: str) -> TopicTally:
        """Return the tally of a topic."""
        return self.tallies.setdefault(topic, TopicTally())

    def next_file(self) -> Continuity:
        """Return the state for the next file."""
        following = {topic: tally.next_file() for topic, tally in self.tallies.items()}
        return Continuity(self.timeline, following)
