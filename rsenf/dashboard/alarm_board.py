"""Alarms of all feeds: the latest, newest first, with their recordings; and the log of all by day.

The log is a file of JSON Lines in the archive's folder, one line for each change of an alarm; the
last line of an alarm holds. Without an archive it is kept in memory, up to a number of alarms.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import shlex
from collections import Counter, deque
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from rsenf.config import redact
from rsenf.dashboard.enf_series import in_ms, rounded
from rsenf.messages import Alarm, Header, Mark
from rsenf.record.archive.layout import ArchivedFile, archived_files
from rsenf.timebase import NS_PER_S

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
        with contextlib.suppress(OSError):  # a full disk must not hide the alarm
            self._put(Raised(number, feed, message, start_ns, end_ns, identity, ack))
        while len(self._raised) > KEPT_ALARMS:
            raised = self._raised.values()
            del self._raised[min((r.message.active, r.number) for r in raised)[1]]

    def _put(self, raised: Raised) -> None:
        before = self._raised.get(raised.number)
        self._raised[raised.number] = raised
        if before and (before.message.active, before.ack) == (raised.message.active, raised.ack):
            return
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
        said = {"by": by, "note": note, "at_ms": in_ms(now_ns)}
        try:
            self._put(raised._replace(ack=said))
        except OSError:
            self._raised[number] = raised
            raise
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
        with contextlib.suppress(OSError):
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


MCAP_END = b"\x89MCAP0\r\n"
LEAD_S = 10.0  # replay starts this long before the alarm
AROUND_NS = 60 * NS_PER_S  # the recording of an alarm starts within this time of it
MOST = 8


def files_about(archive: Path, raised: Raised) -> list[dict[str, Any]]:
    """List the files that contain an alarm, for JSON; those recorded for alarms come first.

    Parameters
    ----------
    archive : Path
        Folder of the archive.
    raised : Raised
    """
    of_feed = [file for file in archived_files(archive) if str(file.camera) == raised.feed]
    kept = [f for f in of_feed if f.of_alarm and abs(f.start_ns - raised.start_ns) < AROUND_NS]
    running = _covering([f for f in of_feed if not f.of_alarm], raised)
    return [_file_plain(archive, file, raised) for file in [*kept, *running][:MOST]]


def file_named(archive: Path, name: str) -> Path | None:
    """Return the archive's file with a relative path; None for any other path.

    A link that leads out of the archive is none of its files.
    """
    paths = (file.path for file in archived_files(archive))
    path = next((path for path in paths if path.relative_to(archive).as_posix() == name), None)
    return path if path and path.resolve().is_relative_to(archive.resolve()) else None


def _covering(files: list[ArchivedFile], raised: Raised) -> list[ArchivedFile]:
    """Return the files that overlap with an alarm. Each file lasts until the next one starts."""
    ends_ns = [file.start_ns for file in files[1:]]
    ends_ns += [_written_ns(file.path) for file in files[-1:]]
    return [
        file
        for file, end_ns in zip(files, ends_ns, strict=True)
        if file.start_ns <= raised.end_ns and end_ns >= raised.start_ns
    ]


def _written_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:  # deleted by retention meanwhile
        return 0


def _file_plain(archive: Path, file: ArchivedFile, raised: Raised) -> dict[str, Any]:
    start_s = 0.0
    if not file.of_alarm:  # a file of an alarm starts shortly before it anyway
        start_s = max(0.0, (raised.start_ns - file.start_ns) / NS_PER_S - LEAD_S)
    from_there = f" --start-s {start_s:.0f}" if start_s >= 1 else ""
    size_bytes, is_whole = state_of(file.path)
    return {
        "name": file.path.name,
        "url": "recordings/" + file.path.relative_to(archive).as_posix(),
        "size_mb": round(size_bytes / 1e6, 1),
        "is_whole": is_whole,
        "of_alarm": file.of_alarm,
        "replay": f"rsenf replay {shlex.quote(str(file.path))}{from_there}",
    }


def state_of(path: Path) -> tuple[int, bool]:
    """Return the size of a recording in bytes, and whether it has been closed."""
    try:
        with path.open("rb") as file:
            size_bytes = file.seek(0, 2)
            file.seek(-min(len(MCAP_END), size_bytes), 2)
            return size_bytes, file.read() == MCAP_END
    except FileNotFoundError:
        return 0, False


FILE = "alarms.jsonl"
VERSION = 1
KEPT_LINES = 200  # in memory
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
        self._lines: deque[str] = deque(maxlen=KEPT_LINES)
        acknowledged = deque(((line["id"], line["ack"]) for line in self._read() if line["ack"]),
                             KEPT_LINES)  # fmt: skip
        self._acknowledged = dict(acknowledged)

    def acknowledgement(self, identity: str) -> dict[str, Any] | None:
        """Return by whom an alarm was acknowledged, with the note and the time; None if it isn't.

        Parameters
        ----------
        identity : str
            Of the alarm, the same after a restart.
        """
        return self._acknowledged.get(identity)

    def note(self, identity: str, alarm: dict[str, Any]) -> None:
        """Note what has become of an alarm.

        Parameters
        ----------
        identity : str
        alarm : dict
            As the page has it.

        Raises
        ------
        OSError
            When the file can't be written to.
        """
        line = json.dumps({"version": VERSION, "id": identity, **alarm}, allow_nan=False)
        if self._path is None:
            self._lines.append(line)
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("ab", buffering=0) as file:  # each line in one write
            file.write(line.encode() + b"\n")

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
        latest = {line["id"]: line for line in self._read()}
        count = Counter(_day(line) for line in latest.values())
        days = sorted(count, reverse=True)
        day = day if day in count else next(iter(days), "")
        alarms = sorted(
            (line for line in latest.values() if _day(line) == day),
            key=lambda line: float(line["start_ms"]),
            reverse=True,
        )
        return {
            "days": [[name, count[name]] for name in days],
            "day": day,
            "alarms": alarms[:MOST_OF_A_DAY],
        }

    def _read(self) -> Iterator[dict[str, Any]]:
        """Yield the lines; one that was cut off by a crash is left out."""
        for text in self._texts():
            try:
                line = json.loads(text)
                _day(line)
                _ = line["id"], line["ack"]
            except (ValueError, KeyError, TypeError, OverflowError):
                continue
            yield line

    def _texts(self) -> Iterator[str]:
        if self._path is None:
            yield from tuple(self._lines)
        elif self._path.is_file():
            with self._path.open(encoding="utf-8", errors="replace") as file:
                yield from file


def _day(line: dict[str, Any]) -> str:
    return datetime.fromtimestamp(line["start_ms"] / 1000, UTC).strftime("%Y-%m-%d")
