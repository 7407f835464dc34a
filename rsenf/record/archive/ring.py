"""The last minutes of a camera, in memory, until an alarm asks for them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

from rsenf.messages import Header, VideoPacket, decode

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
        self.begun_ns = begun_ns
        self.messages: list[Kept] = []
        self.has_video = False
        self.size_bytes = 0

    def add(self, message: Kept) -> None:
        self.messages.append(message)
        self.size_bytes += len(message.payload) + MESSAGE_BYTES
        self.has_video |= message.cls is VideoPacket


class Ring:
    """Keeps so much time, and somewhat more, so that its video begins with a key frame.

    Parameters
    ----------
    keep_ns : int
        How much time.
    most_bytes : int
        Where this isn't enough for that time, the oldest go, and are counted.

    Attributes
    ----------
    forgotten : int
        Messages that had to go before their time.
    """

    def __init__(self, keep_ns: int, most_bytes: int) -> None:
        self.forgotten = 0
        self._keep_ns, self._most_bytes = keep_ns, most_bytes
        self._stretches: deque[_Stretch] = deque()
        self._size_bytes = 0

    def __iter__(self) -> Iterator[Kept]:
        for stretch in self._stretches:
            yield from stretch.messages

    def add(self, message: Kept) -> None:
        """Keep a message, and forget what is too old."""
        if not self._stretches or self._begins_another(message):
            self._stretches.append(_Stretch(message.received_ns))
        newest = self._stretches[-1]
        self._size_bytes -= newest.size_bytes
        newest.add(message)
        self._size_bytes += newest.size_bytes
        since_ns = message.received_ns - self._keep_ns
        while len(self._stretches) > 1 and self._stretches[1].begun_ns <= since_ns:
            self._drop()
        while self._size_bytes > self._most_bytes:
            self.forgotten += self._drop()

    def _begins_another(self, message: Kept) -> bool:
        newest = self._stretches[-1]
        if message.cls is VideoPacket:
            return bool(decode(VideoPacket, message.payload).keyframe)
        return not newest.has_video and message.received_ns - newest.begun_ns >= STRETCH_NS

    def _drop(self) -> int:
        oldest = self._stretches.popleft()
        self._size_bytes -= oldest.size_bytes
        return len(oldest.messages)
