"""Alarms, the newest first, each with when it began and ended."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

from rsenf.config import redact
from rsenf.dashboard.plain import in_ms, rounded
from rsenf.messages import Alarm, Mark

KEPT_ALARMS = 200


class Raised(NamedTuple):
    """An alarm as it stands."""

    number: int
    feed: str
    message: Alarm
    start_ns: int
    end_ns: int


class AlarmBoard:
    """The latest alarms. One that is said again, or said to have ended, is the same alarm."""

    def __init__(self) -> None:
        self._raised: OrderedDict[tuple[Any, ...], Raised] = OrderedDict()
        self._number = 0

    def update(self, feed: str, message: Alarm, log_time_ns: Callable[[], int]) -> None:
        """Take in an alarm.

        Parameters
        ----------
        feed : str
            Of which camera.
        message : Alarm
        log_time_ns : callable
            When it was by the clock of the day.
        """
        header = message.header
        if header.mark != Mark.DATA:
            return
        key = feed, message.kind, header.run_id, header.epoch, message.start_pts_ns
        before = self._raised.get(key)
        if before is None:
            self._number += 1
        offset_ns = log_time_ns() - header.pts_ns
        self._raised[key] = Raised(
            before.number if before else self._number,
            feed,
            message,
            before.start_ns if before else offset_ns + message.start_pts_ns,
            offset_ns + max(message.end_pts_ns, message.start_pts_ns),
        )
        while len(self._raised) > KEPT_ALARMS:
            self._raised.popitem(last=False)

    def __getitem__(self, number: int) -> Raised | None:
        return next((r for r in self._raised.values() if r.number == number), None)

    def active(self, feed: str) -> int:
        """How many of a camera have not ended."""
        return sum(r.feed == feed and r.message.active for r in self._raised.values())

    def plain(self) -> list[dict[str, Any]]:
        """All of them for JSON, the newest first."""
        newest_first = sorted(self._raised.values(), key=lambda r: r.number, reverse=True)
        return [_plain(raised) for raised in newest_first]


def _plain(raised: Raised) -> dict[str, Any]:
    message = raised.message
    return {
        "number": raised.number,
        "feed": raised.feed,
        "kind": message.kind,
        "severity": message.severity,
        "active": message.active,
        "start_ms": in_ms(raised.start_ns),
        "end_ms": in_ms(raised.end_ns),
        "value": rounded(message.value, 4),
        "limit": rounded(message.limit, 4),
        "unit": message.unit,
        "text": redact(message.text),
    }
