"""Files of one camera: rotation, and recording only around alarms.

Consecutive files are each complete in themselves. Around an alarm, the minutes before it come from
a ring buffer in memory.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from rsenf.messages import Header, VideoPacket, decode
from rsenf.record.archive.layout import day_of
from rsenf.record.limits import MB, AlarmSettings, Rotation
from rsenf.record.sequence import Continuity, Timeline
from rsenf.record.writer import Recorder
from rsenf.timebase import nanoseconds

# A full file waits for a key frame up to this multiple of its limits; then it is ended anyway.
PATIENCE = 2
STRETCH_NS = 1_000_000_000
MESSAGE_BYTES = 1000  # Python's overhead for each message


class CameraFiles:
    """Begins a file with the first message, and another whenever a file is full.

    Each file has all schemas and metadata, and its video begins with a key frame. Sequence numbers
    continue, so that consecutive files show whether anything is missing between them.

    Parameters
    ----------
    begin : callable
        Opens a new file; takes the state carried over from the file before.
    rotation : Rotation
        Limits of a file.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    continuity : Continuity
        State for the first file.

    Attributes
    ----------
    recorder : Recorder or None
        The open file; None between files.
    """

    def __init__(
        self,
        begin: Callable[[Continuity], Recorder],
        rotation: Rotation,
        clock_ns: Callable[[], int],
        continuity: Continuity,
    ) -> None:
        self._begin, self._clock_ns = begin, clock_ns
        self._every_ns = nanoseconds(rotation.every_s)
        self._size_bytes = round(rotation.size_mb * MB)
        self._continuity = continuity
        self.recorder: Recorder | None = None
        self._begun_ns = 0
        self._has_video = False

    def write_encoded(self, topic: str, cls: type[Any], payload: bytes, header: Header) -> bool:
        """Record a message, as :meth:`rsenf.record.Recorder.write_encoded`."""
        if self._is_full(1) and (not self._has_video or _is_key_frame(cls, payload)):
            self.end_file()
        if self.recorder is None:
            self._begun_ns, self._has_video = self._clock_ns(), False
            self.recorder = self._begin(self._continuity)
        if cls is VideoPacket:
            self._has_video = not header.is_end
        return self.recorder.write_encoded(topic, cls, payload, header)

    def tick(self) -> None:
        """Flush if due, and close a full file. To be called often."""
        if self.recorder is None:
            return
        if self._is_full(PATIENCE if self._has_video else 1):
            self.end_file()
        else:
            self.recorder.tick()

    def flush(self) -> None:
        """Write all pending messages of the open file, if any."""
        if self.recorder is not None:
            self.recorder.flush()

    def end_file(self) -> None:
        """Close the open file, if any."""
        if self.recorder is not None:
            recorder, self.recorder = self.recorder, None
            recorder.close()
            self._continuity = self._continuity.next_file()

    def _is_full(self, times: int) -> bool:
        if self.recorder is None:
            return False
        now_ns = self._clock_ns()
        age_ns = now_ns - self._begun_ns  # negative if the clock was set back
        other_day = times == 1 and day_of(now_ns) != day_of(self._begun_ns)
        too_old = other_day or not 0 <= age_ns < times * self._every_ns
        return too_old or self.recorder.size_bytes >= times * self._size_bytes


def _is_key_frame(cls: type[Any], payload: bytes) -> bool:
    return cls is VideoPacket and bool(decode(VideoPacket, payload).keyframe)


class Kept(NamedTuple):
    """A serialised message, with its time of arrival."""

    received_ns: int
    topic: str
    cls: type[Any]
    payload: bytes
    header: Header


class _Stretch:
    """Messages that are dropped together: from one key frame to the next, or of one second."""

    def __init__(self, begun_ns: int) -> None:
        self.begun_ns = self.video_ns = begun_ns  # video_ns: time of the latest video packet
        self.messages: deque[Kept] = deque()
        self.size_bytes = 0

    def add(self, message: Kept) -> None:
        self.messages.append(message)
        self.size_bytes += _size(message)
        if message.cls is VideoPacket:
            self.video_ns = message.received_ns

    def pop(self) -> Kept:
        oldest = self.messages.popleft()
        self.size_bytes -= _size(oldest)
        return oldest


def _size(message: Kept) -> int:
    return len(message.payload) + MESSAGE_BYTES


class Ring:
    """Ring buffer of the messages of at least ``keep_ns``, whose video begins with a key frame.

    If the messages between two key frames last longer than ``keep_ns``, or exceed the memory limit,
    they are cut: then the oldest pictures can't be decoded, but all other messages are kept.

    Parameters
    ----------
    keep_ns : int
        Time to keep.
    most_bytes : int
        Memory limit; beyond it the oldest messages are dropped and counted.

    Attributes
    ----------
    forgotten : int
        Messages of the time to keep that were dropped for lack of memory.
    """

    def __init__(self, keep_ns: int, most_bytes: int) -> None:
        self._keep_ns, self._most_bytes = keep_ns, most_bytes
        self._stretches: deque[_Stretch] = deque()
        self._size_bytes = 0
        self._forgotten_ns: deque[int] = deque()  # arrival times of dropped messages

    def __iter__(self) -> Iterator[Kept]:
        for stretch in self._stretches:
            yield from stretch.messages

    @property
    def forgotten(self) -> int:
        """Number of messages dropped for lack of memory."""
        return len(self._forgotten_ns)

    def add(self, message: Kept) -> None:
        """Add a message, and drop those that are too old."""
        if not self._stretches or self._begins_another(message):
            self._stretches.append(_Stretch(message.received_ns))
        self._stretches[-1].add(message)
        self._size_bytes += _size(message)
        since_ns = message.received_ns - self._keep_ns
        while len(self._stretches) > 1 and self._stretches[1].begun_ns <= since_ns:
            self._size_bytes -= self._stretches.popleft().size_bytes
        while self._size_bytes > self._most_bytes:
            self._make_room()
        while self._forgotten_ns and self._forgotten_ns[0] < since_ns:
            self._forgotten_ns.popleft()

    def _begins_another(self, message: Kept) -> bool:
        newest, now_ns = self._stretches[-1], message.received_ns
        if message.cls is VideoPacket:
            too_long = now_ns - newest.begun_ns >= max(self._keep_ns, STRETCH_NS)
            return too_long or _is_key_frame(message.cls, message.payload)
        return now_ns - newest.video_ns >= STRETCH_NS  # no video, or no more

    def _make_room(self) -> None:
        """Drop the oldest stretch; of a single one, only as much as necessary."""
        oldest, alone = self._stretches[0], len(self._stretches) == 1
        while oldest.messages and (not alone or self._size_bytes > self._most_bytes):
            message = oldest.pop()
            self._size_bytes -= _size(message)
            self._forgotten_ns.append(message.received_ns)
        if not oldest.messages:
            self._stretches.popleft()


class AlarmFiles(CameraFiles):
    """Keeps a camera's last minutes in memory, and records them when an alarm comes.

    Parameters
    ----------
    begin, rotation, clock_ns
        As for :class:`CameraFiles`.
    settings : AlarmSettings
        Times to record before and after an alarm.
    """

    def __init__(
        self,
        begin: Callable[[Continuity], Recorder],
        rotation: Rotation,
        clock_ns: Callable[[], int],
        settings: AlarmSettings,
    ) -> None:
        # The time line uses the arrival of messages, not the time at which they are written.
        self._moment_ns = clock_ns()
        timeline = Timeline(lambda: self._moment_ns)
        super().__init__(begin, rotation, clock_ns, Continuity(timeline))
        self._after_ns = nanoseconds(settings.after_s)
        self._ring = Ring(nanoseconds(settings.before_s), round(settings.memory_mb * MB))
        self._until_ns: int | None = None

    def write_encoded(self, topic: str, cls: type[Any], payload: bytes, header: Header) -> bool:
        """Keep a message, and record it during an alarm; return whether it was recorded."""
        message = Kept(self._clock_ns(), topic, cls, payload, header)
        self._ring.add(message)
        return self._until_ns is not None and self._record(message)

    def alarm(self) -> None:
        """Start recording with the kept messages; stop some time after the last alarm."""
        begins = self._until_ns is None
        self._until_ns = self._clock_ns() + self._after_ns
        if begins:
            for message in self._ring:
                self._record(message)
            if self.recorder is not None and self._ring.forgotten:
                forgotten = {"messages": str(self._ring.forgotten), "why": "memory_mb was reached"}
                self.recorder.add_metadata("rsenf.forgotten", forgotten)

    def tick(self) -> None:
        """Flush if due, and close the file after the alarm. To be called often."""
        now_ns = self._clock_ns()
        if self._until_ns is not None:  # sooner where the clock was set back
            self._until_ns = min(self._until_ns, now_ns + self._after_ns)
        if self._until_ns is not None and now_ns >= self._until_ns:
            self._until_ns = None
            self.end_file()
            # Messages until the next file aren't meant to be recorded.
            self._continuity = Continuity(self._continuity.timeline)
        super().tick()

    def _record(self, message: Kept) -> bool:
        self._moment_ns = message.received_ns
        return super().write_encoded(*message[1:])
