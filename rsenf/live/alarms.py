"""The active alarms of a camera, and a message whenever one begins or ends."""

from __future__ import annotations

import dataclasses
from typing import Any

from rsenf.messages import Alarm, Header
from rsenf.timebase import NS_PER_S

QUIET_NS = 30 * NS_PER_S  # an instantaneous event ends after this time without repetition


class Alarms:
    """The alarms of one camera."""

    def __init__(self) -> None:
        self._on: dict[str, tuple[Alarm, int | None]] = {}
        self._out: list[Alarm] = []
        self._sent: Header | None = None

    def happened(self, alarm: Alarm, now_ns: int) -> None:
        """Raise an alarm for an instantaneous event; it ends by itself QUIET_NS later."""
        self._raise(alarm, now_ns + QUIET_NS)

    def holds(self, alarm: Alarm) -> None:
        """Raise an alarm that lasts until :meth:`over`."""
        self._raise(alarm, None)

    def _raise(self, alarm: Alarm, until_ns: int | None) -> None:
        if alarm.kind not in self._on:
            self._send(alarm)
        first = self._on[alarm.kind][0] if alarm.kind in self._on else alarm
        self._on[alarm.kind] = first, until_ns

    def over(self, kind: str, header: Header, now_ns: int, **told: Any) -> None:
        """End an alarm, with fields that tell more by now; does nothing if it isn't active."""
        if kind in self._on:
            alarm, _ = self._on.pop(kind)
            told |= {"header": header, "active": False, "end_pts_ns": now_ns}
            self._send(dataclasses.replace(alarm, **told))

    def pass_by(self, header: Header, now_ns: int) -> None:
        """End instantaneous alarms that have expired, by the stream's clock."""
        for kind, (_, until_ns) in list(self._on.items()):
            if until_ns is not None and now_ns >= until_ns:
                self.over(kind, header, now_ns)

    def new_epoch(self, header: Header, now_ns: int) -> None:
        """End all alarms but 'lost', which the next picture ends: the stream's clock is reset."""
        for kind in [kind for kind in self._on if kind != "lost"]:
            self.over(kind, header, now_ns)

    def taken(self) -> list[Alarm]:
        """Return the messages since the last call."""
        out, self._out = self._out, []
        return out

    def _send(self, alarm: Alarm) -> None:
        self._sent = numbered_after(self._sent, alarm.header)
        self._out.append(dataclasses.replace(alarm, header=self._sent))


def numbered_after(last: Header | None, header: Header) -> Header:
    """Return ``header`` with the sequence number after ``last``; 0 in a new run or epoch."""
    is_new = last is None or (last.run_id, last.epoch) != (header.run_id, header.epoch)
    return header.numbered(0 if last is None or is_new else last.seq + 1)
