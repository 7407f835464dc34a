"""Alarms, the newest first, each with when it began and ended."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

from rsenf.config import redact
from rsenf.dashboard.plain import in_ms, rounded
from rsenf.messages import Alarm, Header, Mark

KEPT_ALARMS = 200  # those that have ended go first
NEVER_LIVE = ("stale", "frozen", "loop", "lost")


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
        self._raised: dict[int, Raised] = {}  # by number, so in the order of their coming
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
        offset_ns = log_time_ns() - header.pts_ns
        start_ns = offset_ns + message.start_pts_ns
        number = self._known(feed, message)
        if number is None:
            self._end_those_before(feed, message.kind)
            self._number += 1
            number = self._number
        before = self._raised.get(number)
        self._raised[number] = Raised(
            number,
            feed,
            message,
            before.start_ns if before else start_ns,
            max(offset_ns + message.end_pts_ns, before.start_ns if before else start_ns),
        )
        while len(self._raised) > KEPT_ALARMS:
            raised = self._raised.values()
            del self._raised[min((r.message.active, r.number) for r in raised)[1]]

    def _known(self, feed: str, message: Alarm) -> int | None:
        """Number of the alarm that is said again, or that is said to have ended."""
        for number, raised in reversed(self._raised.items()):
            if (raised.feed, raised.message.kind) != (feed, message.kind):
                continue
            # What ends it may be that the stream's clock has begun anew: no time tells which.
            is_end = raised.message.active and not message.active
            return number if is_end or _began(raised.message) == _began(message) else None
        return None

    def _end_those_before(self, feed: str, kind: str) -> None:
        """End what nobody will end any more: of a kind there is one at a time."""
        for raised in self._active(feed):
            if raised.message.kind == kind:
                self._end(raised)

    def is_live(self, feed: str, header: Header) -> None:
        """End what isn't so where a feed is live; a judge that died can't say so any more."""
        for raised in self._active(feed):
            own = raised.message.header
            is_later = _stream(own) != _stream(header) or own.pts_ns < header.pts_ns
            if raised.message.kind in NEVER_LIVE and is_later:
                self._end(raised)

    def _active(self, feed: str) -> list[Raised]:
        return [r for r in self._raised.values() if r.feed == feed and r.message.active]

    def _end(self, raised: Raised) -> None:
        over = dataclasses.replace(raised.message, active=False)
        self._raised[raised.number] = raised._replace(message=over)

    def __getitem__(self, number: int) -> Raised | None:
        return self._raised.get(number)

    def active(self, feed: str) -> int:
        """How many of a camera have not ended."""
        return len(self._active(feed))

    def plain(self) -> list[dict[str, Any]]:
        """All of them for JSON, the newest first."""
        return [_plain(raised) for raised in reversed(self._raised.values())]


def _began(message: Alarm) -> tuple[str, int, int]:
    return *_stream(message.header), message.start_pts_ns


def _stream(header: Header) -> tuple[str, int]:
    return header.run_id, header.epoch


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
