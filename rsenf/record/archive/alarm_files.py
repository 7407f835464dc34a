"""Files about alarms alone: the minutes before, from memory, and the minutes after."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rsenf.messages import Header
from rsenf.record.archive.camera_files import CameraFiles
from rsenf.record.archive.ring import Kept, Ring
from rsenf.record.continuity import Continuity
from rsenf.record.disk import MB
from rsenf.record.settings import AlarmSettings, Rotation
from rsenf.record.timeline import Timeline
from rsenf.record.writer import Recorder
from rsenf.timebase import nanoseconds


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
