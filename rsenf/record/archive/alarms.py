"""What an archive notes of alarms, in JSON Lines that are only ever appended to.

``site/camera/alarms.jsonl`` holds the time spans of a camera's alarms, whose files are kept.
Removing a line permits the deletion of its time span.

``alarms.jsonl`` in the archive's folder is the dashboard's log of all cameras: one line for each
change of an alarm. The last line of an alarm holds, and its last acknowledgement.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from rsenf.errors import reason_of
from rsenf.record.archive.layout import Camera

VERSION = 1
NAME = "alarms.jsonl"


def _append(path: Path, entries: Iterable[Mapping[str, Any]]) -> None:
    """Append lines in one write, and wait for the disk; OSError unless all of it was written."""
    lines = "".join(f"{json.dumps(entry, allow_nan=False)}\n" for entry in entries).encode()
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b", buffering=0) as file:
        if file.seek(0, os.SEEK_END):
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":  # the line before was cut off
                lines = b"\n" + lines
        if file.write(lines) != len(lines):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        os.fsync(file.fileno())


class AlarmSpan(NamedTuple):
    """The time span of an alarm, UTC in ns, and its reason."""

    from_ns: int
    to_ns: int
    why: str

    def covers(self, first_ns: int, last_ns: int) -> bool:
        """Whether it overlaps with another time span."""
        return self.from_ns <= last_ns and first_ns <= self.to_ns


def add_alarm(root: Path, camera: Camera, span: AlarmSpan) -> None:
    """Append an alarm to the camera's file, and wait for the disk.

    Parameters
    ----------
    root : Path
        Folder of the archive.
    camera : Camera
    span : AlarmSpan

    Raises
    ------
    OSError
        When it can't be written.
    """
    times = {"from_ns": str(span.from_ns), "to_ns": str(span.to_ns)}
    entry = {"version": VERSION, **times, "why": span.why}
    _append(root / camera.site / camera.name / NAME, [entry])


def alarms_of(root: Path, camera: Camera) -> list[AlarmSpan]:
    """Return a camera's alarms in order of arrival; invalid lines are skipped."""
    try:
        lines = (root / camera.site / camera.name / NAME).read_bytes().splitlines()
    except FileNotFoundError:
        return []
    return [span for span in map(_span, lines) if span is not None]


def _span(line: bytes) -> AlarmSpan | None:
    try:
        entry = json.loads(line)
        span = AlarmSpan(int(entry["from_ns"]), int(entry["to_ns"]), str(entry["why"]))
        return span if 0 <= span.from_ns <= span.to_ns < 2**63 else None
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


KEPT_LINES = 200  # in memory
READ_BYTES = 8_000_000  # from the end of the file: some 10,000 alarms
KEPT_ACKNOWLEDGEMENTS = 10_000
MOST_OF_A_DAY = 500


class AlarmLog:
    """Alarms and acknowledgements of all cameras. Only the end of a long file is read.

    Without an archive the last lines are kept in memory.

    Parameters
    ----------
    root : Path or None
        Folder of the archive.
    """

    def __init__(self, root: Path | None = None) -> None:
        self._path = root / NAME if root else None
        # In memory alone: what couldn't be written yet, or all without an archive.
        self._entries: deque[dict[str, Any]] = deque(maxlen=KEPT_LINES)
        self._why = ""
        self._acknowledged: dict[str, dict[str, Any]] = {}
        for entry in self._read():
            self._remember(entry["id"], entry["ack"])

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
        return self._why if self._path and self._entries else ""

    def note(self, identity: str, alarm: dict[str, Any]) -> None:
        """Note what has become of an alarm; what can't be written is kept, and written later.

        Parameters
        ----------
        identity : str
        alarm : dict
            As the page has it.
        """
        self._entries.append({"version": VERSION, "id": identity, **alarm})
        self.catch_up()

    def acknowledge(self, identity: str, alarm: dict[str, Any]) -> None:
        """Keep an alarm's acknowledgement; parameters as for :meth:`note`.

        Raises
        ------
        OSError
            When it can't be written. Then it isn't kept.
        """
        self._write({"version": VERSION, "id": identity, **alarm})
        self._remember(identity, alarm["ack"])

    def catch_up(self) -> None:
        """Write what couldn't be written before, if it can be now."""
        with contextlib.suppress(OSError):
            self._write()

    def _write(self, *new: dict[str, Any]) -> None:
        if self._path is None:
            self._entries.extend(new)
        elif entries := [*self._entries, *new]:
            try:
                _append(self._path, entries)
            except OSError as exc:
                reason = f"{exc.filename or self._path}: {reason_of(exc)}"
                self._why = f"{reason}; the last changes of alarms are in memory alone"
                raise
            self._entries.clear()

    def _remember(self, identity: str, ack: dict[str, Any] | None) -> None:
        if ack:
            self._acknowledged[identity] = ack
        if len(self._acknowledged) > KEPT_ACKNOWLEDGEMENTS:
            del self._acknowledged[next(iter(self._acknowledged))]

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
        latest = _latest(self._read())
        count = Counter(_day(alarm["start_ms"]) for alarm in latest)
        days = sorted(count, reverse=True)
        day = day if day in count else next(iter(days), "")
        alarms = sorted(
            (alarm for alarm in latest if _day(alarm["start_ms"]) == day),
            key=lambda alarm: float(alarm["start_ms"]),
            reverse=True,
        )
        return {
            "days": [[name, count[name]] for name in days],
            "day": day,
            "alarms": alarms[:MOST_OF_A_DAY],
        }

    def _read(self) -> Iterator[dict[str, Any]]:
        if self._path:
            yield from _logged(self._path, READ_BYTES)
        yield from filter(_is_whole, tuple(self._entries))


def acknowledged(root: Path) -> list[dict[str, Any]]:
    """Return the last state of all alarms that somebody acknowledged on the dashboard.

    Parameters
    ----------
    root : Path
        Folder of the archive.
    """
    return _latest(_logged(root / NAME), only_acknowledged=True)


def _latest(
    entries: Iterable[dict[str, Any]], *, only_acknowledged: bool = False
) -> list[dict[str, Any]]:
    """Return the last state of each alarm, with its last acknowledgement."""
    latest: dict[str, dict[str, Any]] = {}
    for entry in entries:
        ack = entry["ack"] or latest.get(entry["id"], entry)["ack"]
        if ack or not only_acknowledged:
            latest[entry["id"]] = {**entry, "ack": ack}
    return list(latest.values())


def _logged(path: Path, last_bytes: int | None = None) -> Iterator[dict[str, Any]]:
    """Yield a log's entries; a line that is damaged, or of another version, is left out."""
    if not path.is_file():
        return
    with path.open("rb") as file:
        if last_bytes is not None:
            file.seek(max(0, os.fstat(file.fileno()).st_size - last_bytes))
        for line in file:  # the first may be cut off
            try:
                entry = json.loads(line.decode(errors="replace"))
            except (ValueError, RecursionError):
                continue
            if _is_whole(entry):
                yield entry


def _is_whole(entry: Any) -> bool:
    try:
        said = entry["ack"] or {"by": "", "note": ""}
        words = entry["id"], entry["feed"], entry["kind"], said["by"], said["note"]
        _ = _day(entry["start_ms"]), _day(entry["end_ms"])
        return entry["version"] == VERSION and all(isinstance(word, str) for word in words)
    except (ValueError, KeyError, TypeError, OverflowError, OSError):
        return False


def _day(time_ms: float) -> str:
    return datetime.fromtimestamp(time_ms / 1000, UTC).strftime("%Y-%m-%d")
