"""Alarms of all feeds: the latest, newest first; and the log of all by day.

The log is a file of JSON Lines in the archive's folder, one line for each change of an alarm; the
last line of an alarm holds, and its last acknowledgement. Only the end of a long file is read, so
that memory is bounded. Without an archive it is kept in memory, up to a number of lines.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import json
import os
from collections import Counter, deque
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from rsenf.config import redact
from rsenf.dashboard.enf_series import in_ms, rounded
from rsenf.messages import Alarm, Header, Mark

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
            self._end_those_before(feed, message.kind)
            self._number += 1
            number = self._number
        before = self._raised.get(number)
        start_ns = before.start_ns if before else start_ns
        end_ns = max(offset_ns + message.end_pts_ns, start_ns)
        identity = before.identity if before else _identity(feed, message)
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

    def _end_those_before(self, feed: str, kind: str) -> None:
        """End active alarms of a kind: there is only one at a time, and its end was missed."""
        for raised in self._active(feed):
            if raised.message.kind == kind:
                self._end(raised)

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


def _identity(feed: str, message: Alarm) -> str:
    return " ".join(map(str, (feed, message.kind, *_began(message))))


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


FILE = "alarms.jsonl"
VERSION = 1
KEPT_LINES = 200  # in memory
READ_BYTES = 8_000_000  # from the end of the file: some 10,000 alarms
KEPT_ACKNOWLEDGEMENTS = 10_000
MOST_OF_A_DAY = 500
LONGEST_NAME, LONGEST_NOTE = 64, 500


class AlarmLog:
    """Alarms and acknowledgements, kept.

    Parameters
    ----------
    folder : Path or None
        Of the archive.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._path = folder / FILE if folder else None
        # In memory alone: what couldn't be written yet, or all without an archive.
        self._lines: deque[str] = deque(maxlen=KEPT_LINES)
        self._why = ""
        self._acknowledged: dict[str, dict[str, Any]] = {}
        for line in self._read():
            self._remember(line["id"], line["ack"])

    def acknowledgement(self, identity: str) -> dict[str, Any] | None:
        """Return by whom an alarm was acknowledged, with the note and the time; None if it isn't.

        Parameters
        ----------
        identity : str
            Of the alarm, the same after a restart.
        """
        return self._acknowledged.get(identity)

    @property
    def unwritten(self) -> str:
        """Why the last changes aren't in the file; empty if they are, or there is no archive."""
        return self._why if self._path and self._lines else ""

    def note(self, identity: str, alarm: dict[str, Any]) -> None:
        """Note what has become of an alarm; what can't be written is kept, and written later.

        Parameters
        ----------
        identity : str
        alarm : dict
            As the page has it.
        """
        self._lines.append(_line(identity, alarm))
        self.catch_up()

    def acknowledge(self, identity: str, alarm: dict[str, Any]) -> None:
        """Keep an alarm's acknowledgement; parameters as for :meth:`note`.

        Raises
        ------
        OSError
            When it can't be written. Then it isn't kept.
        """
        self._write(_line(identity, alarm))
        self._remember(identity, alarm["ack"])

    def catch_up(self) -> None:
        """Write what couldn't be written before, if it can be now."""
        with contextlib.suppress(OSError):
            self._write()

    def _write(self, *new: str) -> None:
        if self._path is None:
            self._lines.extend(new)
        elif lines := [*self._lines, *new]:
            try:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                _append(self._path, "".join(f"{line}\n" for line in lines).encode())
            except OSError as exc:
                reason = f"{exc.filename or self._path}: {(exc.strerror or str(exc)).lower()}"
                self._why = f"{reason}; the last changes of alarms are in memory alone"
                raise
            self._lines.clear()

    def _remember(self, identity: str, ack: dict[str, Any] | None) -> None:
        if ack:
            self._acknowledged[identity] = ack
        if len(self._acknowledged) > KEPT_ACKNOWLEDGEMENTS:
            del self._acknowledged[next(iter(self._acknowledged))]

    def alarms(self) -> list[dict[str, Any]]:
        """Return the last state of each alarm, with its last acknowledgement."""
        latest: dict[str, dict[str, Any]] = {}
        for line in self._read():
            before = latest.get(line["id"], line)
            latest[line["id"]] = {**line, "ack": line["ack"] or before["ack"]}
        return list(latest.values())

    def day(self, day: str) -> dict[str, Any]:
        """Return the days that have alarms, with their numbers, and the alarms of one.

        Parameters
        ----------
        day : str
            As ``2026-01-15``, UTC; the last one if there is no such day.

        Returns
        -------
        dict
            ``days``: day and number of alarms, newest first; ``day``; ``alarms``, newest first.
        """
        latest = self.alarms()
        count = Counter(_day(line["start_ms"]) for line in latest)
        days = sorted(count, reverse=True)
        day = day if day in count else next(iter(days), "")
        alarms = sorted(
            (line for line in latest if _day(line["start_ms"]) == day),
            key=lambda line: float(line["start_ms"]),
            reverse=True,
        )
        return {
            "days": [[name, count[name]] for name in days],
            "day": day,
            "alarms": alarms[:MOST_OF_A_DAY],
        }

    def _read(self) -> Iterator[dict[str, Any]]:
        """Yield the lines; one that is damaged, or of another version, is left out."""
        for text in self._texts():
            try:
                line = json.loads(text)
                said = line["ack"] or {"by": "", "note": ""}
                words = line["id"], line["feed"], line["kind"], said["by"], said["note"]
                _ = _day(line["start_ms"]), _day(line["end_ms"])
                is_whole = line["version"] == VERSION and all(isinstance(w, str) for w in words)
            except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
                continue
            if is_whole:
                yield line

    def _texts(self) -> Iterator[str]:
        if self._path and self._path.is_file():
            with self._path.open("rb") as file:
                file.seek(max(0, os.fstat(file.fileno()).st_size - READ_BYTES))
                for line in file:  # the first may be cut off
                    yield line.decode(errors="replace")
        yield from tuple(self._lines)


def _line(identity: str, alarm: dict[str, Any]) -> str:
    return json.dumps({"version": VERSION, "id": identity, **alarm}, allow_nan=False)


def _append(path: Path, lines: bytes) -> None:
    """Append lines in one write; OSError unless all of it was written."""
    with path.open("a+b", buffering=0) as file:
        if file.seek(0, os.SEEK_END):
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":  # the line before was cut off
                lines = b"\n" + lines
        if file.write(lines) != len(lines):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _day(time_ms: float) -> str:
    return datetime.fromtimestamp(time_ms / 1000, UTC).strftime("%Y-%m-%d")
