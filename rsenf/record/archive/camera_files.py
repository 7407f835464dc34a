"""One camera's files, one after the other, each complete in itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rsenf.messages import Header, VideoPacket, decode
from rsenf.record.archive.layout import day_of
from rsenf.record.continuity import Continuity
from rsenf.record.disk import MB
from rsenf.record.settings import Rotation
from rsenf.record.writer import Recorder
from rsenf.timebase import nanoseconds

# Video that has no key frame for as long again goes on in the next file without one.
PATIENCE = 2


class CameraFiles:
    """Begins a file with the first message, and the next one when a file is full.

    Each file has all schemas and metadata, its video begins with a key frame, and numbers go on:
    where one file ends and the next begins tells that nothing is missing between them.

    Parameters
    ----------
    begin : callable
        Opens a new file, given what goes on from the one before.
    rotation : Rotation
        When a file is full.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    continuity : Continuity
        What the first file goes on from.
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
        self._recorder: Recorder | None = None
        self._begun_ns = 0
        self._has_video = False

    @property
    def recorder(self) -> Recorder | None:
        """The file in the making; None between files."""
        return self._recorder

    def write_encoded(self, topic: str, cls: type[Any], payload: bytes, header: Header) -> bool:
        """Record a message, as :meth:`rsenf.record.Recorder.write_encoded`."""
        if self._is_full(1) and (not self._has_video or _is_key_frame(cls, payload)):
            self.end_file()
        if self._recorder is None:
            self._begun_ns, self._has_video = self._clock_ns(), False
            self._recorder = self._begin(self._continuity)
        if cls is VideoPacket:
            self._has_video = not header.is_end
        return self._recorder.write_encoded(topic, cls, payload, header)

    def tick(self) -> None:
        """Flush if it is time to, and end a file that is full. To be called often."""
        if self._recorder is None:
            return
        if self._is_full(PATIENCE if self._has_video else 1):
            self.end_file()
        else:
            self._recorder.tick()

    def end_file(self) -> None:
        """Close the file in the making, if there is one."""
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            recorder.close()
            self._continuity = self._continuity.next_file()

    def forget(self) -> None:
        """Count anew from the next file on: what comes until then is not to be recorded."""
        self._continuity = Continuity(self._continuity.timeline)

    def _is_full(self, times: int) -> bool:
        if self._recorder is None:
            return False
        now_ns = self._clock_ns()
        age_ns = now_ns - self._begun_ns  # below 0 when the clock was set back
        other_day = times == 1 and day_of(now_ns) != day_of(self._begun_ns)
        too_old = other_day or not 0 <= age_ns < times * self._every_ns
        return too_old or self._recorder.size_bytes >= times * self._size_bytes


def _is_key_frame(cls: type[Any], payload: bytes) -> bool:
    return cls is VideoPacket and bool(decode(VideoPacket, payload).keyframe)
