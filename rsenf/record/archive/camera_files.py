"""File rotation for one camera: consecutive files, each complete in itself."""

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

# A full file waits for a key frame up to this multiple of its limits; then it is ended anyway.
PATIENCE = 2


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
        """The open file; None between files."""
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
        """Flush if due, and close a full file. To be called often."""
        if self._recorder is None:
            return
        if self._is_full(PATIENCE if self._has_video else 1):
            self.end_file()
        else:
            self._recorder.tick()

    def end_file(self) -> None:
        """Close the open file, if any."""
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            recorder.close()
            self._continuity = self._continuity.next_file()

    def forget(self) -> None:
        """Reset the sequence numbers: messages until the next file aren't meant to be recorded."""
        self._continuity = Continuity(self._continuity.timeline)

    def _is_full(self, times: int) -> bool:
        if self._recorder is None:
            return False
        now_ns = self._clock_ns()
        age_ns = now_ns - self._begun_ns  # negative if the clock was set back
        other_day = times == 1 and day_of(now_ns) != day_of(self._begun_ns)
        too_old = other_day or not 0 <= age_ns < times * self._every_ns
        return too_old or self._recorder.size_bytes >= times * self._size_bytes


def _is_key_frame(cls: type[Any], payload: bytes) -> bool:
    return cls is VideoPacket and bool(decode(VideoPacket, payload).keyframe)
