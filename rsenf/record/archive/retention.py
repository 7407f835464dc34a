"""Deletes the oldest files of an archive, by age and disk share, except those of alarms.

The time spans of a camera's alarms are stored as one line of JSON each, in
``site/camera/alarms.jsonl``. Removing a line permits the deletion of its time span.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from rsenf.record.archive.layout import ArchivedFile, Camera, archived_files
from rsenf.record.limits import DiskLimits, Retention, Usage, disk_usage, low_bytes
from rsenf.record.output import is_held
from rsenf.timebase import nanoseconds

VERSION = 1
NAME = "alarms.jsonl"
DAY_S = 86_400
_ROOM = 1.5  # free space to keep, as a multiple of the warning limit: avoids the warning


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
    path = root / camera.site / camera.name / NAME
    path.parent.mkdir(parents=True, exist_ok=True)
    entry = {
        "version": VERSION,
        "from_ns": str(span.from_ns),
        "to_ns": str(span.to_ns),
        "why": span.why,
    }
    with open(path, "a+b") as file:
        file.seek(0, os.SEEK_END)
        if file.tell():
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":  # the previous line is truncated
                file.write(b"\n")
        file.write(json.dumps(entry).encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def alarms_of(root: Path, camera: Camera) -> list[AlarmSpan]:
    """Return a camera's alarms in order of arrival; invalid lines are skipped."""
    try:
        lines = (root / camera.site / camera.name / NAME).read_bytes().splitlines()
    except FileNotFoundError:
        return []
    return [span for span in map(_read, lines) if span is not None]


def _read(line: bytes) -> AlarmSpan | None:
    try:
        entry = json.loads(line)
        span = AlarmSpan(int(entry["from_ns"]), int(entry["to_ns"]), str(entry["why"]))
        return span if 0 <= span.from_ns <= span.to_ns < 2**63 else None
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


_ALWAYS = AlarmSpan(0, 2**63, "alarms that can't be read")


class _Aged(NamedTuple):
    file: ArchivedFile
    size_bytes: int
    last_ns: int  # time of its last change


class Keeper:
    """Applies the rules; never deletes a file being written, nor one that overlaps with an alarm.

    Parameters
    ----------
    root : Path
        Folder of the archive.
    rules : Retention
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    limits : DiskLimits
        When the disk counts as nearly full.
    usage : callable
        Returns size and free space of the disk.
    warn : callable
        Called with a text, once for each file that can't be deleted or read. It stays; no other
        file is deleted in its place.
    """

    def __init__(
        self,
        root: Path,
        rules: Retention,
        clock_ns: Callable[[], int],
        *,
        limits: DiskLimits = DiskLimits(),  # noqa: B008  # frozen
        usage: Callable[[Path], Usage] = disk_usage,
        warn: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._root, self._rules, self._clock_ns, self._usage = root, rules, clock_ns, usage
        self._limits, self._warn, self._warned = limits, warn, set[str]()

    def apply(self) -> list[Path]:
        """Delete the files that the rules no longer permit; return them, oldest first."""
        files = [aged for aged in map(_age, archived_files(self._root)) if aged is not None]
        too_many = self._too_many(sum(aged.size_bytes for aged in files))
        alarms = {c: self._alarms_of(c) for c in {aged.file.camera for aged in files}}
        days = self._rules.days
        oldest_ns = 0 if days is None else self._clock_ns() - nanoseconds(days * DAY_S)
        gone = []
        for aged in files:
            due = too_many > 0 or aged.last_ns < oldest_ns
            if due and not self._stays(aged, alarms) and self._delete(aged.file.path):
                too_many -= aged.size_bytes
                gone.append(aged.file.path)
        for folder in {path.parent for path in gone}:
            with contextlib.suppress(OSError):
                folder.rmdir()  # succeeds for an empty day
        return gone

    def _too_many(self, held_bytes: int) -> float:
        """Return the bytes above the archive's share, or missing from the free space to keep."""
        if self._rules.disk_share is None:
            return 0.0
        total, free = self._usage(self._root)
        lacking = _ROOM * low_bytes(self._limits, total) - free
        return max(held_bytes - self._rules.disk_share * total, lacking)

    def _alarms_of(self, camera: Camera) -> list[AlarmSpan]:
        try:
            return alarms_of(self._root, camera)
        except OSError as exc:
            self._tell(exc)
            return [_ALWAYS]

    def _stays(self, aged: _Aged, alarms: dict[Camera, list[AlarmSpan]]) -> bool:
        spans = alarms[aged.file.camera]
        if any(span.covers(aged.file.start_ns, aged.last_ns) for span in spans):
            return True
        try:
            return is_held(aged.file.path)
        except FileNotFoundError:
            return False
        except OSError as exc:
            self._tell(exc)
            return True

    def _delete(self, path: Path) -> bool:
        try:
            path.unlink(missing_ok=True)
        except OSError as exc:
            self._tell(exc)
            return False
        return True

    def _tell(self, exc: OSError) -> None:
        if str(exc.filename) not in self._warned:
            self._warned.add(str(exc.filename))
            reason = (exc.strerror or str(exc)).lower()
            self._warn(f"{exc.filename}: {reason}; it stays in the archive")


def _age(file: ArchivedFile) -> _Aged | None:
    try:
        found = file.path.stat()
    except FileNotFoundError:  # deleted meanwhile by another process
        return None
    return _Aged(file, found.st_size, found.st_mtime_ns)
