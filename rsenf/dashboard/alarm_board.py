"""The latest alarms of all feeds, newest first. Each change goes to the archive's log."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

from rsenf.config import redact
from rsenf.dashboard.enf_series import in_ms, rounded
from rsenf.messages import Alarm, Header, Mark
from rsenf.record.archive.alarms import AlarmLog

KEPT_ALARMS = 200  # beyond that the ended ones are dropped first
NEVER_LIVE = ("stale", "frozen", "loop", "lost")


class Raised(NamedTuple):
    """The current state of an alarm; times are UTC."""

    number: int
    feed: str
    message: Alarm
    start_ns: int
    end_ns: int
    identity: str  # the same after a restart
    ack: dict[str, Any] | None  # by whom it was acknowledged, with a note, and when


class AlarmBoard:
    """The latest alarms. A repetition or the end of an alarm updates its entry.

    Parameters
    ----------
    log : AlarmLog
        Keeps them.
    """

    def __init__(self, log: AlarmLog) -> None:
        self.log = log
        self._raised: dict[int, Raised] = {}  # by number, which is the order of arrival
        self._number = 0

    def update(self, feed: str, message: Alarm, log_time_ns: Callable[[], int]) -> None:
        """Take an alarm.

        Parameters
        ----------
        feed : str
            Its camera.
        message : Alarm
        log_time_ns : callable
            Returns the wall-clock time of the message's ``pts_ns``, in ns.
        """
        header = message.header
        if header.mark != Mark.DATA:
            return
        offset_ns = log_time_ns() - header.pts_ns
        start_ns = offset_ns + message.start_pts_ns
        number = self._known(feed, message)
        if number is None:
            # There is only one of a kind at a time: the end of one before was missed.
            for missed in [r for r in self._active(feed) if r.message.kind == message.kind]:
                self._end(missed)
            self._number += 1
            number = self._number
        before = self._raised.get(number)
        start_ns = before.start_ns if before else start_ns
        end_ns = max(offset_ns + message.end_pts_ns, start_ns)
        own = feed, message.kind, *_began(message)
        identity = before.identity if before else " ".join(map(str, own))
        ack = before.ack if before else self.log.acknowledgement(identity)
        self._put(Raised(number, feed, message, start_ns, end_ns, identity, ack))
        while len(self._raised) > KEPT_ALARMS:
            raised = self._raised.values()
            del self._raised[min((r.message.active, r.number) for r in raised)[1]]

    def _put(self, raised: Raised) -> None:
        before = self._raised.get(raised.number)
        self._raised[raised.number] = raised
        if before and before.message.active == raised.message.active:
            self.log.catch_up()
        else:
            self.log.note(raised.identity, _plain(raised))

    def acknowledge(self, number: int, by: str, note: str, now_ns: int) -> bool:
        """Note who has seen an alarm; return whether there is such an alarm.

        Parameters
        ----------
        number : int
        by, note : str
            Name and remark.
        now_ns : int
            UTC since 1970.

        Raises
        ------
        OSError
            When it can't be kept.
        """
        raised = self._raised.get(number)
        if raised is None:
            return False
        raised = raised._replace(ack={"by": by, "note": note, "at_ms": in_ms(now_ns)})
        self.log.acknowledge(raised.identity, _plain(raised))
        self._raised[number] = raised
        return True

    def _known(self, feed: str, message: Alarm) -> int | None:
        """Return the number of the alarm that a message repeats or ends; None if it is new."""
        for number, raised in reversed(self._raised.items()):
            if (raised.feed, raised.message.kind) != (feed, message.kind):
                continue
            # An end always fits: if the stream's clock was reset, start times can't be compared.
            is_end = raised.message.active and not message.active
            return number if is_end or _began(raised.message) == _began(message) else None
        return None

    def is_live(self, feed: str, header: Header) -> None:
        """End alarms that contradict a live feed. A stage that crashed couldn't end them."""
        for raised in self._active(feed):
            alarm = raised.message.header
            is_later = _stream(alarm) != _stream(header) or alarm.pts_ns < header.pts_ns
            if raised.message.kind in NEVER_LIVE and is_later:
                self._end(raised)

    def _active(self, feed: str) -> list[Raised]:
        return [r for r in self._raised.values() if r.feed == feed and r.message.active]

    def _end(self, raised: Raised) -> None:
        over = dataclasses.replace(raised.message, active=False)
        self._put(raised._replace(message=over))

    def __getitem__(self, number: int) -> Raised | None:
        return self._raised.get(number)

    def active(self, feed: str) -> int:
        """Return the number of a camera's active alarms."""
        return len(self._active(feed))

    def plain(self) -> list[dict[str, Any]]:
        """Return all alarms for JSON, newest first."""
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
        "ack": raised.ack,
    }
