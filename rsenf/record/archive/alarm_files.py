"""Files about alarms alone: the minutes before, from memory, and the minutes after.

The last minutes of a camera, in memory, until an alarm asks for them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from rsenf.messages import Header, VideoPacket, decode
from rsenf.record.archive.camera_files import CameraFiles
from rsenf.record.continuity import Continuity
from rsenf.record.disk import MB
from rsenf.record.settings import AlarmSettings, Rotation
from rsenf.record.timeline import Timeline
from rsenf.record.writer import Recorder
from rsenf.timebase import nanoseconds

STRETCH_NS = 1_000_000_000
MESSAGE_BYTES = 1000  # that Python keeps beside a payload


class Kept(NamedTuple):
    """A message as it came, and when."""

    received_ns: int
    topic: str
    cls: type[Any]
    payload: bytes
    header: Header


class _Stretch:
    """Messages that are forgotten together: from one key frame to the next, or a second's."""

    def __init__(self, begun_ns: int) -> None:
        self.begun_ns = self.video_ns = begun_ns  # the latest of the video
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
    """Keeps so much time, and somewhat more, so that its video begins with a key frame.

    A stretch between key frames that is longer than that, or larger than may be, is cut: then the
    oldest pictures can't be decoded, but all else is there.

    Parameters
    ----------
    keep_ns : int
        How much time.
    most_bytes : int
        Where this isn't enough for that time, the oldest go, and are counted.

    Attributes
    ----------
    forgotten : int
        Messages of that time that had to go, for lack of memory.
    """

    def __init__(self, keep_ns: int, most_bytes: int) -> None:
        self._keep_ns, self._most_bytes = keep_ns, most_bytes
        self._stretches: deque[_Stretch] = deque()
        self._size_bytes = 0
        self._forgotten_ns: deque[int] = deque()  # when they were received

    def __iter__(self) -> Iterator[Kept]:
        for stretch in self._stretches:
            yield from stretch.messages

    @property
    def forgotten(self) -> int:
        """How many messages lack."""
        return len(self._forgotten_ns)

    def add(self, message: Kept) -> None:
        """Keep a message, and forget what is too old."""
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
            return too_long or bool(decode(VideoPacket, message.payload).keyframe)
        return now_ns - newest.video_ns >= STRETCH_NS  # where there is, or was, no video

    def _make_room(self) -> None:
        """Forget the oldest stretch, or of the only one as much as must be."""
        oldest, alone = self._stretches[0], len(self._stretches) == 1
        while oldest.messages and (not alone or self._size_bytes > self._most_bytes):
            message = oldest.pop()
            self._size_bytes -= _size(message)
            self._forgotten_ns.append(message.received_ns)
        if not oldest.messages:
            self._stretches.popleft()


class AlarmFiles:
    """Keeps a camera's last minutes in memory, and writes them when an alarm comes.

    Parameters
    ----------
    begin, rotation, clock_ns
        As for :class:`CameraFiles`.
    settings : AlarmSettings
        How much before and after an alarm.
    """

    def __init__(
        self,
        begin: Callable[[Continuity], Recorder],
        rotation: Rotation,
        clock_ns: Callable[[], int],
        settings: AlarmSettings,
    ) -> None:
        self._clock_ns = clock_ns
        self._after_ns = nanoseconds(settings.after_s)
        self._ring = Ring(nanoseconds(settings.before_s), round(settings.memory_mb * MB))
        self._until_ns: int | None = None
        # Messages lie on the time line where they came, not where they were written.
        self._moment_ns = clock_ns()
        timeline = Timeline(lambda: self._moment_ns)
        self._files = CameraFiles(begin, rotation, clock_ns, Continuity(timeline))

    @property
    def recorder(self) -> Recorder | None:
        """The file in the making; None while there is no alarm."""
        return self._files.recorder

    def write_encoded(self, topic: str, cls: type[Any], payload: bytes, header: Header) -> bool:
        """Keep a message; record it when an alarm is on. Returns whether it was recorded."""
        message = Kept(self._clock_ns(), topic, cls, payload, header)
        self._ring.add(message)
        return self._until_ns is not None and self._record(message)

    def alarm(self) -> None:
        """Record what is kept, and all that comes until some time has passed since the last one."""
        begins = self._until_ns is None
        self._until_ns = self._clock_ns() + self._after_ns
        if begins:
            for message in self._ring:
                self._record(message)
            if self.recorder is not None and self._ring.forgotten:
                forgotten = {"messages": str(self._ring.forgotten), "why": "memory_mb was reached"}
                self.recorder.add_metadata("rsenf.forgotten", forgotten)

    def tick(self) -> None:
        """Flush if it is time to, and end the file when the alarm is over. To be called often."""
        if self._until_ns is not None and self._clock_ns() >= self._until_ns:
            self._until_ns = None
            self._files.end_file()
            self._files.forget()
        self._files.tick()

    def end_file(self) -> None:
        """Close the file in the making, if there is one."""
        self._files.end_file()

    def _record(self, message: Kept) -> bool:
        self._moment_ns = message.received_ns
        return self._files.write_encoded(*message[1:])
